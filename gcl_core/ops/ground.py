"""Height above the local ground: an input that depends neither on the sensor nor on the slope."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.native.ground import height_above
from gcl_core.ops.voxelize import AXIS_BITS, BIAS, MARGIN, encode

CELL = 4.0  # metres; a wall or a car does not fill a cell, so that some of it is ground
GHOST_FRACTION = 0.02  # lowest points of a cell that are taken for reflections below the ground


def height_above_ground(
    points: Float[torch.Tensor, 'n 3'], scan: Int64[torch.Tensor, ' n']
) -> Float[torch.Tensor, ' n']:
    """Height over the lowest ground of the 3 x 3 cells of 4 m around each point, metres.

    Args:
        points: z up within a few degrees.
        scan: scan index of each point; scans do not see each other's ground.

    Raises:
        GclError: a point lies more than 130 km away.
    """
    if len(points) == 0:
        return points.new_zeros(0)
    grid = {'axis_bits': AXIS_BITS, 'limit': BIAS - MARGIN}
    compiled = height_above(points, scan, cell=CELL, ghosts=GHOST_FRACTION, **grid)
    return _above(points, scan) if compiled is None else compiled


def _above(
    points: Float[torch.Tensor, 'n 3'], scan: Int64[torch.Tensor, ' n']
) -> Float[torch.Tensor, ' n']:
    """Height over the lowest ground of the cells around each point."""
    cell = torch.floor(points / CELL).long()
    cell[:, 2] = 0
    key = encode(cell) + (scan << 48)
    cells, row, count = torch.unique(key, return_inverse=True, return_counts=True)
    heights = _sorted_within(points[:, 2], row)
    start = torch.cumsum(count, 0) - count
    lowest = heights[start + (count * GHOST_FRACTION).long()]
    ground = lowest.clone()
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            query = cells + (dx << 32) + (dy << 16)
            found = torch.searchsorted(cells, query).clamp(max=len(cells) - 1)
            ground = torch.where(
                cells[found] == query, torch.minimum(ground, lowest[found]), ground
            )
    return points[:, 2] - ground[row]


def _sorted_within(
    values: Float[torch.Tensor, ' n'], group: Int64[torch.Tensor, ' n']
) -> Float[torch.Tensor, ' n']:
    """Sort by group, then by value, in one sort: a float's bits order as it does, sign aside."""
    bits = values.float().contiguous().view(torch.int32)
    ordered = (bits ^ ((bits >> 31) & 0x7FFFFFFF)).long() + (1 << 31)
    low = ((group << 32 | ordered).sort().values & 0xFFFFFFFF) - (1 << 31)
    bits = low.int()
    return (bits ^ ((bits >> 31) & 0x7FFFFFFF)).view(torch.float32).to(values.dtype)
