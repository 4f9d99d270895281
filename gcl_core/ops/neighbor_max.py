"""Maximum over neighbours: the shortcut of a strided KPConv block."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int32

from gcl_core.ops.native.kpconv import neighbor_max_rows

CHUNK_VALUES = 1 << 22  # features gathered at a time


def _by_torch(x: torch.Tensor, neighbors: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    out = x.new_empty(len(neighbors), x.shape[1])
    winner = torch.empty(out.shape, dtype=torch.int32, device=x.device)
    size = max(1, CHUNK_VALUES // max(1, neighbors.shape[1] * x.shape[1]))
    for first in range(0, len(neighbors), size):
        rows = slice(first, first + size)
        table = neighbors[rows].long()
        table = torch.where(table < len(x), table, table[:, :1])
        out[rows], place = x[table].max(1)
        winner[rows] = table.gather(1, place).int()
    return out, winner


class _NeighborMax(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, neighbors: torch.Tensor) -> torch.Tensor:
        compiled = neighbor_max_rows(x, neighbors)
        out, winner = _by_torch(x, neighbors) if compiled is None else compiled
        ctx.save_for_backward(winner)
        ctx.num_inputs = len(x)
        return out

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor, None]:
        (winner,) = ctx.saved_tensors
        total = grad.new_zeros(ctx.num_inputs, grad.shape[1])
        return total.scatter_add_(0, winner.long(), grad), None


def neighbor_max(
    x: Float[torch.Tensor, 'n c'], neighbors: Int32[torch.Tensor, 'm k']
) -> Float[torch.Tensor, 'm c']:
    """Largest feature among the neighbours, channel by channel.

    Args:
        x: features of the inputs.
        neighbors: rows of `x` around each output, `len(x)` where there is none; the first column
            is never missing.

    Raises:
        ValueError: an output has no neighbour.
    """
    if len(neighbors) and int(neighbors[:, 0].max()) >= len(x):
        raise ValueError('a point of the coarser level has no neighbour in the finer one')
    out: torch.Tensor = _NeighborMax.apply(x, neighbors)
    return out
