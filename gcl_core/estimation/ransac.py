"""RANSAC in batches: draw many minimal sets at once, drop the impossible, score the rest.

With 1 to 2 % inliers beyond 20 m, two points instead of three decide whether the right
hypothesis is drawn at all; hence the level form for ground vehicles beside the rigid one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float, Int64

from gcl_core.errors import GclError
from gcl_core.estimation.procrustes import from_three_points, from_two_points, kabsch
from gcl_core.types import Correspondences

DISTINCT_DISTANCE, DISTINCT_ANGLE = 3.0, math.radians(10.0)
SCORE_BLOCK = 1 << 23  # hypotheses x correspondences scored at a time: 32 MB of float32


@dataclass(frozen=True)
class RansacConfig:
    """How a transform is searched for.

    Attributes:
        model: `level` draws two points (yaw and translation, both vehicles level within a few
            degrees), `rigid` three.
        threshold: residual of an inlier, metres.
        samples: most minimal sets drawn.
        batch: minimal sets drawn at a time.
        confidence: stop once an all-inlier set was drawn with this probability.
        edge_ratio: edges of a minimal set agree in length to this ratio (Open3D's check).
        min_edge: shortest edge of a minimal set, metres.
        max_height_difference: of the two sensors' frames, metres; `level` only.
        local_steps: re-estimations from the inliers of the best hypotheses.
        seed: of the draws.
    """

    model: Literal['level', 'rigid'] = 'level'
    threshold: float = 0.8
    samples: int = 1_000_000
    batch: int = 200_000
    confidence: float = 0.9999
    edge_ratio: float = 0.9
    min_edge: float = 4.0
    max_height_difference: float = 3.5
    local_steps: int = 4
    seed: int = 0

    def __post_init__(self) -> None:
        if self.model not in ('level', 'rigid'):
            raise GclError(f'ransac.model is {self.model!r}; choose level or rigid')
        if self.threshold <= 0:
            raise GclError(f'ransac.threshold is {self.threshold}; it must be positive (metres)')


@dataclass(frozen=True)
class Hypothesis:
    """A transform and the support it found.

    Attributes:
        T_target_source: float64.
        score: sum of the inliers' weights.
        inliers: number of correspondences within the threshold.
    """

    T_target_source: Float[torch.Tensor, '4 4']
    score: float
    inliers: int


def ransac(
    correspondences: Correspondences, config: RansacConfig, *, max_yaw: float = math.pi
) -> list[Hypothesis]:
    """Search the transform with the largest support, and the best that is distinct from it.

    The second tells what chance or a repeated scene supports: compare the two before trusting
    the first. Fewer come back if no minimal set, or only one place, passes the checks.

    Args:
        correspondences: matches, weights not negative.
        config: see `RansacConfig`.
        max_yaw: largest heading of the transform, radians.
    """
    points = 2 if config.model == 'level' else 3
    if len(correspondences) < points:
        return []
    generator = torch.Generator().manual_seed(config.seed)
    table = _pair_table(correspondences)
    weight = correspondences.weight.clamp(min=0)
    total = max(float(weight.sum()), 1e-9)
    leaders: list[Hypothesis] = []
    drawn, needed = 0, float(config.samples)
    while drawn < needed:
        sets = torch.randint(len(correspondences), (config.batch, points), generator=generator)
        drawn += config.batch
        T = _hypotheses(correspondences, sets, config, max_yaw)
        if len(T) == 0:
            continue
        scores = _scores(T, table, weight, config.threshold)
        found = [local_optimisation(t, correspondences, config) for t in _distinct_best(T, scores)]
        leaders = _two_leaders(leaders + found)
        share = leaders[0].score / total
        needed = min(config.samples, _samples_needed(share, points, config.confidence))
    return leaders


def distinct(a: Float[torch.Tensor, '*h 4 4'], b: Float[torch.Tensor, '4 4']) -> torch.Tensor:
    """Whether transforms mean another place or heading: over 3 m or 10 degrees apart."""
    away = (a[..., :3, 3] - b[:3, 3]).norm(dim=-1) > DISTINCT_DISTANCE
    trace = (a[..., :3, :3] * b[:3, :3]).sum((-2, -1))
    return away | (trace < 1 + 2 * math.cos(DISTINCT_ANGLE))


def _distinct_best(
    T: Float[torch.Tensor, 'h 4 4'], scores: Float[torch.Tensor, ' h']
) -> list[Float[torch.Tensor, '4 4']]:
    """The best transform, and the best of those distinct from it."""
    best = T[int(scores.argmax())]
    others = torch.where(distinct(T, best), scores, -1.0)
    second = int(others.argmax())
    return [best, T[second]] if float(others[second]) >= 0 else [best]


def _two_leaders(hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """The best hypothesis and the best distinct one, in this order."""
    ranked = sorted(hypotheses, key=lambda h: -h.score)
    first = ranked[0].T_target_source
    others = [h for h in ranked[1:] if bool(distinct(h.T_target_source, first))]
    return ranked[:1] + others[:1]


def _samples_needed(inlier_share: float, points: int, confidence: float) -> float:
    """Draws until a set without outliers has come up (Fischler and Bolles, 1981)."""
    good = min(max(inlier_share, 1e-9) ** points, 1 - 1e-9)
    return math.log(1 - confidence) / math.log(1 - good)


def _hypotheses(
    c: Correspondences, sets: Int64[torch.Tensor, 'h k'], config: RansacConfig, max_yaw: float
) -> Float[torch.Tensor, 'h 4 4']:
    """Solve the minimal sets whose edges agree."""
    for i, j in ((0, 1), (1, 2), (2, 0))[: 1 if config.model == 'level' else 3]:
        p = c.source[sets[:, j]] - c.source[sets[:, i]]
        q = c.target[sets[:, j]] - c.target[sets[:, i]]
        if config.model == 'level':
            level = (p[:, 2] - q[:, 2]).abs() < 1.5 * config.threshold
            p, q = p[:, :2], q[:, :2]
        else:
            level = torch.ones(len(p), dtype=torch.bool)
        a, b = p.norm(dim=1), q.norm(dim=1)
        agree = torch.minimum(a, b) > config.edge_ratio * torch.maximum(a, b)
        agree &= (a - b).abs() < 2.0 * config.threshold
        sets = sets[agree & level & (torch.minimum(a, b) > config.min_edge)]
    solve = from_two_points if config.model == 'level' else from_three_points
    T = solve(c.source[sets], c.target[sets])
    kept = T[:, :3, 3].isfinite().all(1)
    if config.model == 'level':
        kept &= T[:, 2, 3].abs() < config.max_height_difference
    if max_yaw < math.pi:
        kept &= torch.atan2(T[:, 1, 0], T[:, 0, 0]).abs() < max_yaw
    return T[kept]


def _pair_table(c: Correspondences) -> Float[torch.Tensor, '17 n']:
    """Columns whose product with `_transform_rows` is the squared residual of a pair.

    |R p + t - q|^2 = |p|^2 + |q|^2 + |t|^2 + 2 (R^T t).p - 2 t.q - 2 sum_ij R_ij q_i p_j,
    which is bilinear in (R, t) and (p, q): all residuals are one matrix product.
    """
    p, q = c.source, c.target
    outer = (q.unsqueeze(2) * p.unsqueeze(1)).flatten(1)
    squares = (p.square() + q.square()).sum(1, keepdim=True)
    return torch.cat([squares, torch.ones_like(squares), p, q, outer], 1).t().contiguous()


def _transform_rows(T: Float[torch.Tensor, 'h 4 4']) -> Float[torch.Tensor, 'h 17']:
    rotation, t = T[:, :3, :3], T[:, :3, 3]
    back = (rotation.transpose(1, 2) @ t.unsqueeze(2)).squeeze(2)
    ones = torch.ones(len(T), 1, dtype=T.dtype)
    square = t.square().sum(1, keepdim=True)
    return torch.cat([ones, square, 2 * back, -2 * t, -2 * rotation.flatten(1)], 1)


def _scores(
    T: Float[torch.Tensor, 'h 4 4'],
    table: Float[torch.Tensor, '17 n'],
    weight: Float[torch.Tensor, ' n'],
    threshold: float,
) -> Float[torch.Tensor, ' h']:
    """Sum of the inliers' weights for each transform."""
    rows = _transform_rows(T)
    step = max(1, SCORE_BLOCK // table.shape[1])
    blocks = [
        ((rows[i : i + step] @ table) < threshold**2).to(weight.dtype) @ weight
        for i in range(0, len(rows), step)
    ]
    return torch.cat(blocks)


def local_optimisation(
    T: Float[torch.Tensor, '4 4'], c: Correspondences, config: RansacConfig
) -> Hypothesis:
    """Re-estimate all six degrees of freedom from the inliers until the support stops growing."""
    p, q, weight = c.source.double(), c.target.double(), c.weight.clamp(min=0).double()

    def support(candidate: torch.Tensor) -> tuple[float, torch.Tensor]:
        residual = (p @ candidate[:3, :3].t() + candidate[:3, 3] - q).norm(dim=1)
        inlier = residual < config.threshold
        return float(weight[inlier].sum()), inlier

    best = T.double()
    score, inlier = support(best)
    for _ in range(config.local_steps):
        if int(inlier.sum()) < 3:
            break
        candidate = kabsch(p[inlier], q[inlier], weight[inlier] + 1e-6)
        new_score, new_inlier = support(candidate)
        if new_score <= score:
            break
        best, score, inlier = candidate, new_score, new_inlier
    return Hypothesis(best, score, int(inlier.sum()))
