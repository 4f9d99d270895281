"""Points to occupied voxels.

A voxel is one int64 key: 15 bits of scan index, then x, y and z in 16 bits each, biased so that
they are positive. Sorted keys are sorted by scan, x, y, z; voxels one above the other are
neighbours in the list. Halving the resolution is a shift (`coarsen`), a neighbour is an addition.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int64

from gcl_core.errors import GclError
from gcl_core.ops.native.voxelize import group_points
from gcl_core.types import PointCloud, SparseTensor

AXIS_BITS = 16
BIAS = 1 << (AXIS_BITS - 1)
LOW_MASK = (1 << 3 * AXIS_BITS) - 1
HALF_MASK = 0x7FFF7FFF7FFF
MARGIN = 64  # room for kernel offsets at the border, in voxels


def encode(coords: Int64[torch.Tensor, 'n 3']) -> Int64[torch.Tensor, ' n']:
    """Pack integer voxel coordinates of scan 0 into keys; for another, add its index << 48.

    Raises:
        GclError: a coordinate lies outside the grid of 2^16 voxels an axis.
    """
    if len(coords) and int(coords.abs().max()) > BIAS - MARGIN:
        raise GclError(
            f'a point lies {int(coords.abs().max())} voxels from the sensor, the grid ends at '
            f'{BIAS - MARGIN}; remove far outliers or use larger voxels'
        )
    x, y, z = (coords + BIAS).unbind(1)
    return (x << 2 * AXIS_BITS) | (y << AXIS_BITS) | z


def coarsen(keys: Int64[torch.Tensor, ' n']) -> Int64[torch.Tensor, ' n']:
    """Key of the voxel of twice the size that holds each voxel (not unique)."""
    low = keys & LOW_MASK
    return (keys - low) | ((low >> 1) & HALF_MASK)


def refine(keys: Int64[torch.Tensor, ' n']) -> Int64[torch.Tensor, ' n']:
    """Key of the corner voxel of half the size: inverse of `coarsen` for even coordinates."""
    low = keys & LOW_MASK
    return (keys - low) | (low << 1)


def barycentres(
    points: Float[torch.Tensor, 'n 3'], row: Int64[torch.Tensor, ' n'], count: int
) -> Float[torch.Tensor, 'm 3']:
    """Mean of the points of each row; `row[i]` in [0, count) says where point i belongs.

    Summed in float64, so that the order of the points does not matter: they come in another one
    where a scan is turned.
    """
    total = points.new_zeros(count, 3, dtype=torch.float64).index_add_(0, row, points.double())
    size = torch.bincount(row, minlength=count).clamp(min=1).unsqueeze(1)
    return (total / size).to(points.dtype)


def voxelize(clouds: Sequence[PointCloud], *, voxel_size: float, max_range: float) -> SparseTensor:
    """Voxelise a batch of scans; the only feature is the constant 1 of the paper.

    Args:
        clouds: scans, each in its own sensor frame.
        voxel_size: edge of a voxel in metres (the paper: 0.3).
        max_range: points further than this from the sensor, in metres, are left out.

    Raises:
        GclError: no point of a scan lies within `max_range`.
    """
    keys, points, splits = [], [], [0]
    for scan, cloud in enumerate(clouds):
        xyz = torch.from_numpy(cloud.points)
        limits = {'voxel_size': voxel_size, 'max_range': max_range}
        found = group_points(xyz, **limits, axis_bits=AXIS_BITS, limit=BIAS - MARGIN)
        key, mean = found or _grouped(xyz, **limits)
        if len(key) == 0:
            raise GclError(
                f'{cloud.name or f"scan {scan}"}: none of its {len(cloud)} points lies within '
                f'{max_range:g} m of the sensor; check its unit (metres) and frame (origin at the '
                'sensor)'
            )
        keys.append(key + (scan << 3 * AXIS_BITS))
        points.append(mean)
        splits.append(splits[-1] + len(key))
    all_points = torch.cat(points)
    return SparseTensor(
        keys=torch.cat(keys),
        points=all_points,
        features=all_points.new_ones(len(all_points), 1),
        splits=tuple(splits),
    )


def _grouped(
    points: Float[torch.Tensor, 'n 3'], *, voxel_size: float, max_range: float
) -> tuple[Int64[torch.Tensor, ' m'], Float[torch.Tensor, 'm 3']]:
    """Sorted keys and barycentres of the voxels within `max_range`."""
    points = points[points.square().sum(1) <= max_range**2]
    keys, row = torch.unique(encode(torch.floor(points / voxel_size).long()), return_inverse=True)
    return keys, barycentres(points, row, len(keys))
