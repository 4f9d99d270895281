"""Mutual nearest neighbours in feature space, in chunks of bounded memory."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64

from gcl_core.types import Correspondences, Features

CHUNK = 128  # rows of the similarity matrix held at a time: it stays in the cache


def nearest(
    queries: Float[torch.Tensor, 'n d'], candidates: Float[torch.Tensor, 'm d']
) -> tuple[Float[torch.Tensor, ' n'], Int64[torch.Tensor, ' n']]:
    """Return the similarity and the row of each query's most similar candidate."""
    similarity = queries.new_empty(len(queries))
    row = torch.empty(len(queries), dtype=torch.long)
    for start in range(0, len(queries), CHUNK):
        block = queries[start : start + CHUNK] @ candidates.t()
        similarity[start : start + CHUNK], row[start : start + CHUNK] = block.max(1)
    return similarity, row


def match_mutual(*, source: Features, target: Features) -> Correspondences:
    """Keep the pairs of key points that are each other's nearest in feature space."""
    similarity, to_target = nearest(source.descriptors, target.descriptors)
    _, to_source = nearest(target.descriptors, source.descriptors)
    rows = torch.arange(len(source))
    mutual = to_source[to_target] == rows
    return Correspondences(
        source=source.points[mutual],
        target=target.points[to_target[mutual]],
        weight=similarity[mutual],
    )
