"""Mutual nearest neighbours in feature space, in chunks of bounded memory."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64

from gcl_core.types import Correspondences, Features

CHUNK = 1024  # rows of the similarity matrix held at a time


def nearest_both_ways(
    source: Float[torch.Tensor, 'n d'], target: Float[torch.Tensor, 'm d']
) -> tuple[Float[torch.Tensor, ' n'], Int64[torch.Tensor, ' n'], Int64[torch.Tensor, ' m']]:
    """Return best similarity and target row of each source, and source row of each target."""
    similarity = source.new_empty(len(source))
    to_target = torch.empty(len(source), dtype=torch.long)
    best = target.new_full((len(target),), -2.0)
    to_source = torch.zeros(len(target), dtype=torch.long)
    for start in range(0, len(source), CHUNK):
        block = source[start : start + CHUNK] @ target.t()
        similarity[start : start + CHUNK], to_target[start : start + CHUNK] = block.max(1)
        value, row = block.max(0)
        better = value > best
        best = torch.where(better, value, best)
        to_source = torch.where(better, row + start, to_source)
    return similarity, to_target, to_source


def match_mutual(*, source: Features, target: Features) -> Correspondences:
    """Keep the pairs of key points that are each other's nearest in feature space."""
    similarity, to_target, to_source = nearest_both_ways(source.descriptors, target.descriptors)
    rows = torch.arange(len(source))
    mutual = to_source[to_target] == rows
    return Correspondences(
        source=source.points[mutual],
        target=target.points[to_target[mutual]],
        weight=similarity[mutual],
    )
