"""Everything that speaks for or against a hypothesis, as numbers that a judgement weighs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64

from gcl_core.estimation.likeness import KeypointGrid, likeness
from gcl_core.estimation.surface import Surface
from gcl_core.estimation.verify import verify
from gcl_core.types import Heading

SIGNS = {  # whether more of it speaks for a hypothesis or against
    'conflict': -1,
    'surface': 1,
    'close': 1,
    'ground': 1,
    'log_overlap': 1,
    'likeness': 1,
    'log_met': 1,
    'log_support': 1,
    'log_conflict': -1,
    'log_points': -1,  # a dense scan has to fit better than one of 16 beams can
}
COLUMNS = tuple(SIGNS)
NO_CONFLICT = 0.01  # share of conflict below which less says little more: noise, traffic
SWEEP = 100_000  # points, about which `log_points` counts
SPARSEST = 6000  # points; judges were fitted on no sparser scan, and are not stretched to one


@dataclass(frozen=True)
class Scene:
    """The two scans of a pair, ready for checks.

    Attributes:
        source: surfaces.
        target: surfaces.
        headings: of the source: raised key points as described at each.
        keypoints: the target's, by place.
        points: of the sparser scan.
    """

    source: Surface
    target: Surface
    headings: list[Heading]
    keypoints: KeypointGrid
    points: int


def evidence(
    T_target_source: Float[torch.Tensor, 'h 4 4'],
    support: Float[torch.Tensor, ' h'],
    scene: Scene,
    *,
    tolerance: float,
) -> Float[torch.Tensor, 'h 10']:
    """Weigh nothing yet: one row of `COLUMNS` for each hypothesis.

    Args:
        T_target_source: hypotheses.
        support: correspondences that agree with each.
        scene: the two scans.
        tolerance: misalignment that is no conflict, metres.
    """
    T = T_target_source.double()
    fit = verify(T, source=scene.source, target=scene.target, tolerance=tolerance)
    alike, met = torch.zeros(len(T)), torch.zeros(len(T))
    # The heading at which the source was described most like the target is what compares.
    best = nearest_heading(T, scene.headings)
    for number, heading in enumerate(scene.headings):
        rows = torch.nonzero(best == number).squeeze(1)
        if len(rows):
            alike[rows], met[rows] = likeness(T[rows], heading.features, scene.keypoints)
    return torch.stack(
        [
            fit.conflict,
            fit.surface,
            fit.close,
            fit.ground,
            fit.overlap.log1p(),
            alike,
            met.log1p(),
            support.float().log1p(),
            (fit.conflict + NO_CONFLICT).log(),
            torch.full((len(T),), math.log(max(scene.points, SPARSEST) / SWEEP)),
        ],
        1,
    )


def nearest_heading(
    T_target_source: Float[torch.Tensor, 'h 4 4'], headings: Sequence[Heading]
) -> Int64[torch.Tensor, ' h']:
    """Which heading turns the source most nearly as each transform does."""
    x = T_target_source[:, 0, 0] + T_target_source[:, 1, 1]
    y = T_target_source[:, 1, 0] - T_target_source[:, 0, 1]
    alike = [x * math.cos(h.yaw) + y * math.sin(h.yaw) for h in headings]
    return torch.stack(alike, 1).argmax(1)
