"""Height above the local ground: an input that depends neither on the sensor nor on the slope."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.voxelize import encode

CELL = 4.0  # metres; a wall or a car does not fill a cell, so that some of it is ground
GHOST_FRACTION = 0.02  # lowest points of a cell that are taken for reflections below the ground


def height_above_ground(
    points: Float[torch.Tensor, 'n 3'], scan: Int64[torch.Tensor, ' n']
) -> Float[torch.Tensor, ' n']:
    """Height over the lowest ground of the 3 x 3 cells of 4 m around each point, metres.

    Args:
        points: z up within a few degrees.
        scan: scan index of each point; scans do not see each other's ground.
    """
    if len(points) == 0:
        return points.new_zeros(0)
    cell = torch.floor(points / CELL).long()
    cell[:, 2] = 0
    key = encode(cell) + (scan << 48)
    order = torch.argsort(points[:, 2], stable=True)
    order = order[torch.argsort(key[order], stable=True)]
    cells, row, count = torch.unique(key, return_inverse=True, return_counts=True)
    start = torch.cumsum(count, 0) - count
    lowest = points[order[start + (count * GHOST_FRACTION).long()], 2]
    ground = lowest.clone()
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            query = cells + (dx << 32) + (dy << 16)
            found = torch.searchsorted(cells, query).clamp(max=len(cells) - 1)
            ground = torch.where(
                cells[found] == query, torch.minimum(ground, lowest[found]), ground
            )
    return points[:, 2] - ground[row]
