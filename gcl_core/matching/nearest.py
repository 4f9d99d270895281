"""Nearest neighbours in feature space, in chunks of bounded memory.

The compiled twin (ops/native/nearest.cpp) of the mutual search keeps no similarity at all.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.native.nearest import nearest_rows

CHUNK = 256  # rows of the similarity matrix held at a time
Result = TypeVar('Result')


def mutual_nearest(
    source: Float[torch.Tensor, 'n d'], target: Float[torch.Tensor, 'm d']
) -> tuple[Int64[torch.Tensor, ' k'], Int64[torch.Tensor, ' k']]:
    """Rows of source and target that are each other's nearest; each row comes at most once.

    Products are summed in float32.
    """
    if len(source) == 0 or len(target) == 0:
        return torch.empty(0, dtype=torch.long), torch.empty(0, dtype=torch.long)
    value, column, best = nearest_rows(source, target) or _by_chunks(source, target)
    rows = torch.nonzero(value >= best[column]).squeeze(1)
    # Equal similarities (identical descriptors) make several rows nearest: the first keeps it.
    first = torch.full((len(target),), len(source)).scatter_reduce(0, column[rows], rows, 'amin')
    rows = rows[first[column[rows]] == rows]
    return rows, column[rows]


def similarity_of_nearest(
    source: Float[torch.Tensor, 'n d'], target: Float[torch.Tensor, 'm d']
) -> Float[torch.Tensor, ' n']:
    """Similarity of each source row's most similar target row; both have rows."""
    value, *_ = nearest_rows(source, target) or _by_chunks(source, target)
    return value


def _by_chunks(
    source: Float[torch.Tensor, 'n d'], target: Float[torch.Tensor, 'm d']
) -> tuple[Float[torch.Tensor, ' n'], Int64[torch.Tensor, ' n'], Float[torch.Tensor, ' m']]:
    """Similarity and row of each source row's nearest, similarity of each target row's."""
    found = _in_chunks(
        source.float(),
        target.float().t().contiguous(),
        lambda block: (*block.max(1), block.amax(0)),
    )
    value, column, best = zip(*found)
    return torch.cat(value), torch.cat(column), torch.stack(best).amax(0)


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
