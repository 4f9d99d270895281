"""Everything that speaks for or against a hypothesis, as numbers that a judgement weighs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float

from gcl_core.estimation.likeness import KeypointGrid, likeness
from gcl_core.estimation.surface import Surface
from gcl_core.estimation.verify import verify
from gcl_core.types import Features

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
        headings: raised key points of the source as described at each heading, in the frame
            turned by it.
        turns: T_turned_source of each heading.
        keypoints: the target's, by place.
        points: of the sparser scan.
    """

    source: Surface
    target: Surface
    headings: list[Features]
    turns: Float[torch.Tensor, 'turns 4 4']
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
    in_turned_frames = T[:, None] @ torch.linalg.inv(scene.turns)  # (h, turns, 4, 4)
    # The heading at which the source was described most like the target is what compares.
    straightness = in_turned_frames[..., 0, 0] + in_turned_frames[..., 1, 1]
    best = straightness.argmax(1)
    for heading, features in enumerate(scene.headings):
        rows = torch.nonzero(best == heading).squeeze(1)
        if len(rows):
            at = in_turned_frames[rows, heading]
            alike[rows], met[rows] = likeness(at, features, scene.keypoints)
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
