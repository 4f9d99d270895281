"""A transform that correspondences support, and when two of them mean different places."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64

from gcl_core.ops.native.distinct import distinct_rows

DISTINCT_DISTANCE, DISTINCT_ANGLE = 3.0, math.radians(10.0)
LEAST_TRACE = 1 + 2 * math.cos(DISTINCT_ANGLE)
BLOCK = 256  # hypotheses that are compared with each other at a time


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


def distinct(
    a: Float[torch.Tensor, 'h 4 4'], b: Float[torch.Tensor, 'k 4 4']
) -> Bool[torch.Tensor, 'h k']:
    """Whether transforms mean another place or heading: over 3 m or 10 degrees apart."""
    x, y, z = (a[:, None, :3, 3] - b[None, :, :3, 3]).double().square_().unbind(2)
    a, b = a.double(), b.double()
    trace = a.new_zeros(len(a), len(b))
    for i, j in ((i, j) for i in range(3) for j in range(3)):
        trace += a[:, i, j, None] * b[:, i, j]
    return (x + y + z > DISTINCT_DISTANCE**2) | (trace < LEAST_TRACE)


def turned_less(T: Float[torch.Tensor, 'h 4 4'], yaw: float) -> Bool[torch.Tensor, ' h']:
    """Whether headings lie within `yaw` of straight on, radians up to pi."""
    x, y = T[:, 0, 0], T[:, 1, 0]
    return x > math.cos(yaw) * (x.square() + y.square()).sqrt()


def distinct_best(
    T: Float[torch.Tensor, 'h 4 4'], scores: Float[torch.Tensor, ' h'], limit: int
) -> list[int]:
    """Rows of the best transforms, best first, each distinct from all before it."""
    order = scores.argsort(descending=True, stable=True)[: int((scores > 0).sum())]
    limits = {'squared_distance': DISTINCT_DISTANCE**2, 'least_trace': LEAST_TRACE}
    found = distinct_rows(T, order, limit, **limits)
    return _taken(T, order, limit) if found is None else found


def _taken(
    T: Float[torch.Tensor, 'h 4 4'], order: Int64[torch.Tensor, ' n'], limit: int
) -> list[int]:
    rows = list[int]()
    for begin in range(0, len(order), BLOCK):
        block = order[begin : begin + BLOCK]
        block = block[distinct(T[block], T[rows]).all(1)]
        away = distinct(T[block], T[block]).numpy()
        free = np.ones(len(block), dtype=bool)
        for i, row in enumerate(block.tolist()):
            if free[i]:
                rows.append(row)
                free &= away[i]
                if len(rows) == limit:
                    return rows
    return rows


def ranked(hypotheses: list[Hypothesis], limit: int) -> list[Hypothesis]:
    """The best of them that are distinct, best first: two may have grown into one."""
    if not hypotheses:
        return []
    T = torch.stack([h.T_target_source for h in hypotheses])
    scores = torch.tensor([h.score for h in hypotheses])
    return [hypotheses[i] for i in distinct_best(T, scores, limit)]
