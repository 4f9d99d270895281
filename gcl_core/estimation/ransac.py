"""RANSAC in batches: draw many minimal sets at once, drop the impossible, score the rest.

With 1 to 2 % inliers beyond 20 m, two points instead of three decide whether the right
hypothesis is drawn at all; hence the level form for ground vehicles beside the rigid one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import Literal

import torch
from jaxtyping import Bool, Float, Int64

from gcl_core.errors import GclError
from gcl_core.estimation.hypothesis import Hypothesis, distinct_best, ranked, turned_less
from gcl_core.estimation.procrustes import from_three_points, from_two_points
from gcl_core.estimation.support import Support
from gcl_core.types import Correspondences

LARGEST_BATCH = 200_000  # minimal sets held at a time
EDGES = {'level': ((0, 1),), 'rigid': ((0, 1), (1, 2), (2, 0))}


@dataclass(frozen=True)
class RansacConfig:
    """How a transform is searched for.

    Attributes:
        model: `level` draws two points (yaw and translation, both vehicles level within a few
            degrees), `rigid` three.
        threshold: residual of an inlier, metres.
        samples: most minimal sets drawn.
        batch: minimal sets drawn first; then twice as many each time.
        confidence: stop once an all-inlier set was drawn with this probability; 1 never does.
        edge_ratio: edges of a minimal set agree in length to this ratio (Open3D's check).
        min_edge: shortest edge of a minimal set, metres.
        max_height_difference: of the two sensors' frames, metres; `level` only.
        local_steps: re-estimations from the inliers of the best hypotheses.
        keep: distinct hypotheses handed on.
        seed: of the draws.
    """

    model: Literal['level', 'rigid'] = 'level'
    threshold: float = 0.8
    samples: int = 1_000_000
    batch: int = 20_000
    confidence: float = 0.9999
    edge_ratio: float = 0.9
    min_edge: float = 4.0
    max_height_difference: float = 3.5
    local_steps: int = 4
    keep: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        if self.model not in EDGES:
            raise GclError(f'ransac.model is {self.model!r}; choose level or rigid')
        if self.threshold <= 0:
            raise GclError(f'ransac.threshold is {self.threshold}; it must be positive (metres)')
        if min(self.samples, self.batch, self.keep) < 1:
            raise GclError('ransac.samples, ransac.batch and ransac.keep must be at least 1')
        if not 0 < self.confidence <= 1:
            raise GclError(f'ransac.confidence is {self.confidence}; it must lie in (0, 1]')


def ransac(
    correspondences: Correspondences, config: RansacConfig, *, max_yaw: float = math.pi
) -> list[Hypothesis]:
    """Search the transforms with the largest support, best first, each distinct from the others.

    Fewer than `config.keep` come back if fewer places pass the checks; none if none does.

    Args:
        correspondences: finite matches.
        config: see `RansacConfig`.
        max_yaw: largest heading of the transform, radians.
    """
    points = 2 if config.model == 'level' else 3
    if len(correspondences) < points:
        return []
    generator = torch.Generator().manual_seed(config.seed)
    support = Support(correspondences, config.threshold)
    total = max(support.total, 1e-9)
    T, scores = torch.empty(0, 4, 4), torch.empty(0)
    drawn, batch, needed = 0, config.batch, float(config.samples)
    while drawn < needed:
        count = min(batch, config.samples - drawn)
        sets = torch.randint(len(correspondences), (count, points), generator=generator)
        drawn, batch = drawn + count, min(2 * batch, LARGEST_BATCH)
        found = _hypotheses(correspondences, sets, config, max_yaw)
        T, scores = torch.cat([T, found]), torch.cat([scores, support.scores(found)])
        leaders = distinct_best(T, scores, 2 * config.keep)
        T, scores = T[leaders], scores[leaders]
        if len(T):
            share = support.polish(T[:1], config.local_steps)[0].score / total
            needed = min(config.samples, _samples_needed(share, points, config.confidence))
    return ranked(support.polish(T, config.local_steps), config.keep)


def _samples_needed(inlier_share: float, points: int, confidence: float) -> float:
    """Draws until a set without outliers has come up (Fischler and Bolles, 1981)."""
    if confidence == 1:
        return math.inf
    good = min(max(inlier_share, 1e-9) ** points, 1 - 1e-9)
    return math.log(1 - confidence) / math.log(1 - good)


def _hypotheses(
    c: Correspondences, sets: Int64[torch.Tensor, 'h k'], config: RansacConfig, max_yaw: float
) -> Float[torch.Tensor, 'h 4 4']:
    """Solve the minimal sets whose edges agree."""
    level = config.model == 'level'
    ends = torch.cat([c.source, c.target], 1).t().contiguous()
    for i, j in EDGES[config.model]:
        first, second = sets[:, i].contiguous(), sets[:, j].contiguous()
        edges = ends.index_select(1, second) - ends.index_select(1, first)
        sets = sets[_agree(edges[:3], edges[3:], config)]
    T = (from_two_points if level else from_three_points)(c.source[sets], c.target[sets])
    if level:
        kept = T[:, 2, 3].abs() < config.max_height_difference
    else:  # three points on a line, or one point thrice, give no rotation
        kept = (torch.linalg.det(T[:, :3, :3]) - 1).abs() < 1e-3
    if max_yaw < math.pi:
        kept &= turned_less(T, max_yaw)
    return T[kept]


def _agree(
    p: Float[torch.Tensor, '3 h'], q: Float[torch.Tensor, '3 h'], config: RansacConfig
) -> Bool[torch.Tensor, ' h']:
    """Whether two edges are long enough and of one length; of one rise, too, if level."""
    axes = 2 if config.model == 'level' else 3
    a, b = (reduce(torch.add, side[:axes].square().unbind()).sqrt() for side in (p, q))
    shorter, longer = torch.minimum(a, b), torch.maximum(a, b)
    kept = (shorter > config.edge_ratio * longer) & (shorter > config.min_edge)
    kept &= longer - shorter < 2.0 * config.threshold
    if config.model == 'level':
        kept &= (p[2] - q[2]).abs() < 1.5 * config.threshold
    return kept
