"""Nearest neighbours in feature space, in chunks of bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch
from jaxtyping import Float, Int64

CHUNK = 256  # rows of the similarity matrix held at a time: it stays in the cache
LANES = 64  # every 64th column is searched as one: torch's indexed maximum is slow
Result = TypeVar('Result')


def mutual_nearest(
    source: Float[torch.Tensor, 'n d'], target: Float[torch.Tensor, 'm d']
) -> tuple[Int64[torch.Tensor, ' k'], Int64[torch.Tensor, ' k']]:
    """Rows of source and target that are each other's nearest; each row comes at most once."""
    if len(source) == 0 or len(target) == 0:
        return torch.empty(0, dtype=torch.long), torch.empty(0, dtype=torch.long)
    other = _padded(target).t().contiguous()

    def search(block: Float[torch.Tensor, 'c m']) -> tuple[torch.Tensor, ...]:
        return *_row_maximum(block), block.amax(0)

    found = _in_chunks(source, other, search)
    value = torch.cat([chunk[0] for chunk in found])
    column = torch.cat([chunk[1] for chunk in found]).clamp(max=len(target) - 1)
    best = torch.stack([chunk[2] for chunk in found]).amax(0)
    rows = torch.nonzero(value >= best[column]).squeeze(1)
    # Equal similarities (identical descriptors) make several rows nearest: the first keeps it.
    first = torch.full((len(target),), len(source)).scatter_reduce(0, column[rows], rows, 'amin')
    rows = rows[first[column[rows]] == rows]
    return rows, column[rows]


def top_k(
    source: Float[torch.Tensor, 'n d'], target: Float[torch.Tensor, 'm d'], k: int
) -> tuple[Int64[torch.Tensor, ' n*k'], Int64[torch.Tensor, ' n*k']]:
    """Rows of source, each `k` times, and of its `k` most similar target rows."""
    k = min(k, len(target))
    if len(source) == 0 or k == 0:
        return torch.empty(0, dtype=torch.long), torch.empty(0, dtype=torch.long)
    other = target.t().contiguous()
    found = _in_chunks(source, other, lambda block: block.topk(k, 1).indices)
    return torch.arange(len(source)).repeat_interleave(k), torch.cat(found).flatten()


def _in_chunks(
    source: Float[torch.Tensor, 'n d'],
    other: Float[torch.Tensor, 'd m'],
    search: Callable[[torch.Tensor], Result],
) -> list[Result]:
    """Search a few rows at a time, each on one thread: they are too small to be shared."""
    starts = range(0, len(source), CHUNK)
    with ThreadPoolExecutor(max(1, min(torch.get_num_threads(), len(starts)))) as pool:
        return list(pool.map(lambda s: search(source[s : s + CHUNK] @ other), starts))


def _padded(target: Float[torch.Tensor, 'm d']) -> Float[torch.Tensor, 'm+ d']:
    """Repeat the last row until the rows fill the lanes."""
    missing = -len(target) % LANES
    return torch.cat([target, target[-1:].expand(missing, -1)])


def _row_maximum(
    block: Float[torch.Tensor, 'c m'],
) -> tuple[Float[torch.Tensor, ' c'], Int64[torch.Tensor, ' c']]:
    """Largest entry of each row and its column: first its lane, then its place in it."""
    lanes = block.view(len(block), -1, LANES)
    value, lane = lanes.amax(1).max(1)
    place = lanes[torch.arange(len(block)), :, lane].argmax(1)
    return value, place * LANES + lane
