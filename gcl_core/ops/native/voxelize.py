"""The compiled voxelisation as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float32, Int64

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at


def group_points(
    points: Float32[torch.Tensor, 'n 3'],
    *,
    voxel_size: float,
    max_range: float,
    axis_bits: int,
    limit: int,
) -> tuple[Int64[torch.Tensor, ' m'], Float32[torch.Tensor, 'm 3']] | None:
    """Sorted keys and barycentres, see `gcl_core.ops.voxelize`; None if torch has to do it."""
    lib = library() if points.dtype == torch.float32 else None
    if lib is None:
        return None
    points = points.contiguous()
    keys, mean = torch.empty(len(points), dtype=torch.long), torch.empty(len(points), 3)
    lib.gcl_voxelize.restype = ctypes.c_int64
    count = lib.gcl_voxelize(
        *(at(points), ctypes.c_int64(len(points))),
        *(ctypes.c_float(voxel_size), ctypes.c_float(max_range**2)),
        *(ctypes.c_int(axis_bits), ctypes.c_int64(limit), at(keys), at(mean)),
    )
    return None if count < 0 else (keys[:count].clone(), mean[:count].clone())
