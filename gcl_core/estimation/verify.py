"""Dense checks of hypotheses: does what the two scans saw fit together?

A point of one scan must not lie where the other saw through, should lie on a surface of the
other where that could see it, and ground should lie on ground. Counting aligned points without
looking at free space prefers wrong places along a street: walls align with walls.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int32

from gcl_core.estimation.surface import (
    CELL,
    COLUMN_SLOPES,
    GROUND_CELL,
    ROW_SLOPES,
    Surface,
    direction_cell,
    grid_cell,
    grid_shape,
    numbers_of_grid,
    occupied_at,
)
from gcl_core.ops.native.checks import check_counts
from gcl_core.ops.repeatable import moved

# Of the range: a degree of turn or tilt, and the thinning of beams. A float32, so that its product
# with another is exact.
THINNING = float(torch.tensor(0.02))


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
) -> tuple[Float[torch.Tensor, ' h'], ...]:
    """Count solid points visible, in conflict, touching, close; ground known, agreeing."""
    counts = check_counts(
        T,
        (mover.solid, mover.ground),
        (other.near, other.far),
        (COLUMN_SLOPES, ROW_SLOPES),
        (other.occupied, numbers_of_grid(CELL)),
        (other.height, numbers_of_grid(GROUND_CELL)),
        tolerance,
    )
    counts = _counted(T, mover, other, tolerance) if counts is None else counts
    return counts.float().unbind(1)


def _counted(
    T: Float[torch.Tensor, 'h 4 4'], mover: Surface, other: Surface, tolerance: float
) -> Int32[torch.Tensor, 'h 6']:
    points = _moved(T, mover.solid)
    cell, distance, inside = direction_cell(points)
    near, far = other.near.view(-1)[cell], other.far.view(-1)[cell]
    slack = tolerance + THINNING * distance.double()
    # Seen: the other scan has returns in this direction, and none of them hides the point.
    visible = inside & (near > 0) & (distance < far + slack)
    conflict = visible & (distance < near - slack)
    cell, within = grid_cell(points, CELL)
    occupied = occupied_at(other.occupied, cell)
    touching = visible & within & (occupied > 0)
    close = visible & within & (occupied > 1)
    ground = _ground(T, mover, other, tolerance)
    return torch.stack([c.sum(1).int() for c in (visible, conflict, touching, close, *ground)], 1)


def _ground(
    T: Float[torch.Tensor, 'h 4 4'], mover: Surface, other: Surface, tolerance: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Which ground points lie where the other scan knows the ground, and which agree with it."""
    points = _moved(T, mover.ground)
    cell, inside = grid_cell(points, GROUND_CELL)
    height = other.height[cell // grid_shape(GROUND_CELL)[2]]
    known = inside & ~height.isnan()
    return known, known & ((points[:, 2] - height).abs() < 0.5 * tolerance)


def _moved(
    T: Float[torch.Tensor, 'h 4 4'], points: Float[torch.Tensor, 'n 3']
) -> Float[torch.Tensor, 'h 3 n']:
    """Products are exact in float64: it does not matter which are fused with a sum."""
    return moved(T.double(), points.double()).float()
