"""Dense checks of hypotheses: does what the two scans saw fit together?

A point of one scan must not lie where the other saw through, should lie on a surface of the
other where that could see it, and ground should lie on ground. Counting aligned points without
looking at free space prefers wrong places along a street: walls align with walls.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float

from gcl_core.estimation.surface import (
    CELL,
    GROUND_CELL,
    Surface,
    direction_cell,
    grid_cell,
    grid_shape,
)
from gcl_core.ops.repeatable import moved


@dataclass(frozen=True)
class Fit:
    """How well two scans fit together under each of h transforms; shares lie in [0, 1].

    Attributes:
        conflict: share of solid points in space that the other scan saw through.
        surface: share of solid points on a surface of the other scan, of those that it could see.
        close: the same, to half a metre.
        ground: share of ground cells seen by both whose heights agree.
        overlap: number of solid points that the other scan could see.
    """

    conflict: Float[torch.Tensor, ' h']
    surface: Float[torch.Tensor, ' h']
    close: Float[torch.Tensor, ' h']
    ground: Float[torch.Tensor, ' h']
    overlap: Float[torch.Tensor, ' h']


def verify(
    T_target_source: Float[torch.Tensor, 'h 4 4'],
    *,
    source: Surface,
    target: Surface,
    tolerance: float,
) -> Fit:
    """Check transforms, both ways.

    Args:
        T_target_source: transforms.
        source: scan.
        target: scan.
        tolerance: misalignment that is no conflict, metres.
    """
    T = T_target_source.double()
    there = _one_way(T.float(), source, target, tolerance)
    back = _one_way(torch.linalg.inv(T).float(), target, source, tolerance)
    visible, conflict, touching, close, ground, agree = (a + b for a, b in zip(there, back))
    return Fit(
        conflict=conflict / (visible + 1),
        surface=touching / (visible + 1),
        close=close / (visible + 1),
        ground=agree / (ground + 1),
        overlap=visible,
    )


def _one_way(
    T: Float[torch.Tensor, 'h 4 4'], mover: Surface, other: Surface, tolerance: float
) -> list[Float[torch.Tensor, ' h']]:
    """Count solid points visible, in conflict, touching, close; ground known, agreeing."""
    points = moved(T, mover.solid)
    cell, distance, inside = direction_cell(points)
    near, far = other.near.view(-1)[cell], other.far.view(-1)[cell]
    slack = tolerance + 0.02 * distance  # a degree of turn or tilt, and the thinning of beams
    # Seen: the other scan has returns in this direction, and none of them hides the point.
    visible = inside & (near > 0) & (distance < far + slack)
    conflict = visible & (distance < near - slack)
    cell, within = grid_cell(points, CELL)
    occupied = other.occupied[cell]
    touching = visible & within & (occupied > 0)
    close = visible & within & (occupied > 1)
    return [
        c.sum(1).float()
        for c in (visible, conflict, touching, close, *_ground(T, mover, other, tolerance))
    ]


def _ground(
    T: Float[torch.Tensor, 'h 4 4'], mover: Surface, other: Surface, tolerance: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Which ground points lie where the other scan knows the ground, and which agree with it."""
    points = moved(T, mover.ground)
    cell, inside = grid_cell(points, GROUND_CELL)
    height = other.height[cell // grid_shape(GROUND_CELL)[2]]
    known = inside & ~height.isnan()
    return known, known & ((points[:, 2] - height).abs() < 0.5 * tolerance)
