"""Which key points take part in matching: evenly in space, not evenly in index."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.native.spread import spread_rows
from gcl_core.types import Features

CELL = 4.0  # metres; a cell of a dense near field gives as many key points as one far away


def spread(points: Float[torch.Tensor, 'n 3'], limit: int) -> Int64[torch.Tensor, ' k']:
    """Choose at most `limit` rows, one from each cell in turn, so that no region dominates.

    Among those of a cell at random, always the same.
    """
    if len(points) <= limit:
        return torch.arange(len(points))
    order = torch.randperm(len(points), generator=torch.Generator().manual_seed(0))
    rows = spread_rows(points, order, size=CELL, limit=limit)
    return _in_turn(points, order, limit) if rows is None else rows


def _in_turn(
    points: Float[torch.Tensor, 'n 3'], order: Int64[torch.Tensor, ' n'], limit: int
) -> Int64[torch.Tensor, ' k']:
    cell = torch.floor(points[order] / CELL).long()
    key = (cell[:, 0] << 42) + (cell[:, 1] << 21) + cell[:, 2]
    by_cell = torch.argsort(key, stable=True)
    _, count = torch.unique_consecutive(key[by_cell], return_counts=True)
    start = torch.repeat_interleave(torch.cumsum(count, 0) - count, count)
    turn = torch.arange(len(points)) - start  # a point's place in its cell's queue
    chosen = order[by_cell[torch.argsort(turn, stable=True)[:limit]]]
    return chosen.sort().values


def choose(features: Features, limit: int, *, spatially: bool = True) -> Features:
    """Keep at most `limit` key points: spread in space, or any at random, always the same."""
    if len(features) <= limit:
        return features
    if spatially:
        rows = spread(features.points, limit)
    else:
        generator = torch.Generator().manual_seed(0)
        rows = torch.randperm(len(features), generator=generator)[:limit]
    return Features(features.points[rows], features.descriptors[rows])
