"""Features of two scans to correspondences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch

from gcl_core.errors import GclError
from gcl_core.matching.keypoints import choose
from gcl_core.matching.nearest import mutual_nearest, top_k
from gcl_core.ops.precision import best_dtype
from gcl_core.types import Correspondences, Features


@dataclass(frozen=True)
class MatchConfig:
    """How key points are matched.

    Attributes:
        kind: `mutual` keeps pairs that are each other's nearest, `one_way` the nearest target of
            each source key point, `top_k` its k nearest.
        k: of `top_k`.
        keypoints: most key points of a scan that take part.
        spread: choose them evenly in space; otherwise at random (the paper), so that the dense
            near field gets most of them.
    """

    kind: Literal['mutual', 'one_way', 'top_k'] = 'mutual'
    k: int = 3
    keypoints: int = 20_000
    spread: bool = True

    def __post_init__(self) -> None:
        if self.k < 1 or self.keypoints < 1:
            raise GclError(
                f'match.k is {self.k}, match.keypoints {self.keypoints}; they must be at least 1'
            )


def match(
    *,
    source: Features,
    target: Features,
    config: MatchConfig,
    dtype: torch.dtype | None = None,
) -> Correspondences:
    """Match key points by their descriptors, compared in `dtype`: the fastest by default."""
    source = choose(source, config.keypoints, spatially=config.spread)
    target = choose(target, config.keypoints, spatially=config.spread)
    dtype = dtype or best_dtype()
    p, q = source.descriptors.to(dtype), target.descriptors.to(dtype)
    if config.kind == 'mutual':
        rows, columns = mutual_nearest(p, q)
        order = columns.argsort()  # the same however the source is turned
        rows, columns = rows[order], columns[order]
    else:
        rows, columns = top_k(p, q, 1 if config.kind == 'one_way' else config.k)
    similarity = (source.descriptors[rows] * target.descriptors[columns]).sum(1)
    return Correspondences(source.points[rows], target.points[columns], similarity)


def finite(correspondences: Correspondences) -> Correspondences:
    """Drop pairs of which a coordinate or the weight is not finite."""
    c = correspondences
    kept = torch.cat([c.source, c.target, c.weight.unsqueeze(1)], 1).isfinite().all(1)
    if bool(kept.all()):
        return c
    return Correspondences(c.source[kept], c.target[kept], c.weight[kept])
