"""A transform that correspondences support, and when two of them mean different places."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float

DISTINCT_DISTANCE, DISTINCT_ANGLE = 3.0, math.radians(10.0)


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


def distinct(a: Float[torch.Tensor, '*h 4 4'], b: Float[torch.Tensor, '4 4']) -> torch.Tensor:
    """Whether transforms mean another place or heading: over 3 m or 10 degrees apart."""
    away = (a[..., :3, 3] - b[:3, 3]).square().sum(-1) > DISTINCT_DISTANCE**2
    trace = a[..., :3, :3].flatten(-2) @ b[:3, :3].flatten()
    return away | (trace < 1 + 2 * math.cos(DISTINCT_ANGLE))


def distinct_best(
    T: Float[torch.Tensor, 'h 4 4'], scores: Float[torch.Tensor, ' h'], limit: int
) -> list[int]:
    """Rows of the best transforms, best first, each distinct from all before it."""
    scores, rows = scores.clone(), list[int]()
    while len(rows) < limit and len(scores):
        best = int(scores.argmax())
        if scores[best] <= 0:
            break
        rows.append(best)
        scores[~distinct(T, T[best])] = -1.0
    return rows


def ranked(hypotheses: list[Hypothesis], limit: int) -> list[Hypothesis]:
    """The best of them that are distinct, best first: two may have grown into one."""
    if not hypotheses:
        return []
    T = torch.stack([h.T_target_source for h in hypotheses])
    scores = torch.tensor([h.score for h in hypotheses])
    return [hypotheses[i] for i in distinct_best(T, scores, limit)]
