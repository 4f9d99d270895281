"""Second-order spatial consistency: true matches agree on lengths, and on who agrees with whom.

After SC2-PCR (Chen et al., "SC2-PCR: A Second Order Spatial Compatibility for Efficient and
Robust Point Cloud Registration", CVPR 2022), with the level form's checks added: edges agree in
rise as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64

from gcl_core.errors import GclError
from gcl_core.estimation.hypothesis import Hypothesis, distinct_best, ranked, turned_less
from gcl_core.estimation.procrustes import from_moments
from gcl_core.estimation.support import Support
from gcl_core.ops.repeatable import row_sums
from gcl_core.types import Correspondences

POWER_STEPS = 10  # of the leading eigenvector; the paper's code takes as many


@dataclass(frozen=True)
class SpatialConsistencyConfig:
    """How a transform is searched for.

    Attributes:
        threshold: residual of an inlier, and by how much lengths may differ, metres.
        correspondences: the most similar ones that take part; memory grows with the square.
        seeds: correspondences that a consensus set is grown around.
        members: of a consensus set.
        level: both vehicles are level within a few degrees, so that edges agree in rise.
        local_steps: re-estimations from the inliers of the best hypotheses.
        keep: distinct hypotheses handed on.
    """

    threshold: float = 0.8
    correspondences: int = 2000
    seeds: int = 300
    members: int = 20
    level: bool = True
    local_steps: int = 4
    keep: int = 16

    def __post_init__(self) -> None:
        if self.threshold <= 0:
            raise GclError(f'threshold is {self.threshold}; it must be positive (metres)')
        if min(self.correspondences, self.seeds, self.members - 2, self.keep) < 1:
            raise GclError(
                'spatial_consistency: correspondences, seeds, keep must be at least 1, members 3'
            )


def spatial_consistency(
    correspondences: Correspondences,
    config: SpatialConsistencyConfig,
    *,
    max_yaw: float = math.pi,
) -> list[Hypothesis]:
    """Search the transforms with the largest support, best first, each distinct from the others.

    Args:
        correspondences: finite matches.
        config: see `SpatialConsistencyConfig`.
        max_yaw: largest heading of the transform, radians.
    """
    if len(correspondences) < 3:
        return []
    c = _most_similar(correspondences, config.correspondences)
    first = _compatible(c, config).to(torch.float32)
    seeds = _seeds(first, c, config)
    # Second order: how many matches agree with both; only among matches that agree themselves.
    second = first[seeds] * (first[seeds] @ first)
    second[torch.arange(len(seeds)), seeds] = torch.inf  # a seed belongs to its own set
    count = min(config.members, len(c))
    members = second.topk(count, 1)
    support = Support(correspondences, config.threshold)
    chosen = torch.zeros(len(seeds), len(c), dtype=torch.bool)
    chosen.scatter_(1, members.indices, members.values > 0)
    alike = Correspondences(c.source, c.target, torch.ones(len(c)))
    T = from_moments(Support(alike, config.threshold).moments(chosen))
    kept = (chosen.sum(1) >= 3) & T.isfinite().all(2).all(1)
    if max_yaw < math.pi:
        kept &= turned_less(T, max_yaw)
    T = T[kept]
    leaders = distinct_best(T, support.scores(T), 2 * config.keep)
    return ranked(support.polish(T[leaders], config.local_steps), config.keep)


def _distances(points: Float[torch.Tensor, 'n 3']) -> Float[torch.Tensor, 'n n']:
    """Distances between points, each by itself: a matrix product would lose digits as well."""
    return torch.cdist(points, points, compute_mode='donot_use_mm_for_euclid_dist')


def _most_similar(c: Correspondences, limit: int) -> Correspondences:
    rows = torch.argsort(c.weight, descending=True, stable=True)[:limit]
    return Correspondences(c.source[rows], c.target[rows], c.weight[rows])


def _compatible(c: Correspondences, config: SpatialConsistencyConfig) -> Bool[torch.Tensor, 'n n']:
    """Which pairs of correspondences span edges of one length; none with itself."""
    agree = (_distances(c.source) - _distances(c.target)).abs_()
    compatible = agree < config.threshold
    if config.level:
        rise = c.source[:, 2] - c.target[:, 2]
        compatible &= (rise[:, None] - rise).abs_() < 1.5 * config.threshold
    compatible.fill_diagonal_(False)
    return compatible


def _seeds(
    first: Float[torch.Tensor, 'n n'], c: Correspondences, config: SpatialConsistencyConfig
) -> Int64[torch.Tensor, ' s']:
    """Correspondences of the largest eigenvector entries, the best within their reach first."""
    vector = torch.ones(len(c))
    for _ in range(POWER_STEPS):
        vector = row_sums(first * vector)
        vector = vector / vector.amax().clamp(min=1e-9)
    near = _distances(c.source) < 2 * config.threshold
    leading = vector >= torch.where(near, vector, -1.0).amax(1)
    return torch.argsort(vector + leading, descending=True, stable=True)[: config.seeds]
