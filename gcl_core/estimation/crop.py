"""Which points of two scans can meet at all: the rest need neither covariances nor a search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from gcl_core import se3
from gcl_core.ops.native.crop import near

AROUND = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing='ij'), -1).reshape(-1, 3)


class Neighborhood:
    """Tells which points lie near those of one scan.

    Args:
        points: of the scan; at least one.
        reach: all points within it are near, and some up to 3.5 times as far, metres.
    """

    def __init__(self, points: Float[np.ndarray, 'n 3'], reach: float) -> None:
        self._reach = reach
        self._low = points.min(0) - 2 * reach
        occupied = ((points - self._low) / reach).astype(np.int64)
        self._shape = occupied.max(0) + 2
        self._strides = np.array([self._shape[1] * self._shape[2], self._shape[2], 1])
        self._near = np.zeros(self._shape.prod(), dtype=bool)
        self._near[np.unique(occupied @ self._strides)[:, None] + AROUND @ self._strides] = True

    def holds(
        self, points: Float[np.ndarray, 'n 3'], T: Float[np.ndarray, '4 4']
    ) -> Bool[np.ndarray, ' n']:
        """Mark the points that `T` brings near."""
        flat, inside = np.zeros(len(points), dtype=np.int64), np.ones(len(points), dtype=bool)
        x, y, z = points.T.astype(np.float64)  # products of float32 numbers are exact
        for axis, row in enumerate((T[:3] / self._reach).astype(points.dtype)):
            offset = row[3] - points.dtype.type(self._low[axis] / self._reach)
            turn = row.astype(np.float64)
            cell = x * turn[0] + y * turn[1] + z * turn[2] + offset
            inside &= (cell >= 0) & (cell < self._shape[axis])
            flat += cell.astype(np.int64) * self._strides[axis]
        return np.asarray(inside & self._near[np.where(inside, flat, 0)])


def meeting(
    source: Float[np.ndarray, 'n 3'],
    target: Float[np.ndarray, 'm 3'],
    T_target_source: Sequence[Float[np.ndarray, '4 4']],
    reach: float,
) -> tuple[Float[np.ndarray, 'k 3'], Float[np.ndarray, 'l 3']]:
    """Keep the points of each scan that any of the transforms brings near points of the other."""
    if not T_target_source:
        return source[:0], target[:0]
    here = _near(target, source, T_target_source, reach)
    there = _near(source, target, [se3.inverse(T) for T in T_target_source], reach)
    return source[here], target[there]


def _near(
    points: Float[np.ndarray, 'n 3'],
    others: Float[np.ndarray, 'm 3'],
    T_points_others: Sequence[Float[np.ndarray, '4 4']],
    reach: float,
) -> Bool[np.ndarray, ' m']:
    """Mark the others that any of the transforms brings near the points."""
    found = near(points, others, np.stack(T_points_others), reach)
    return _held(points, others, T_points_others, reach) if found is None else found


def _held(
    points: Float[np.ndarray, 'n 3'],
    others: Float[np.ndarray, 'm 3'],
    T_points_others: Sequence[Float[np.ndarray, '4 4']],
    reach: float,
) -> Bool[np.ndarray, ' m']:
    around = Neighborhood(points, reach)
    return np.any([around.holds(others, T) for T in T_points_others], axis=0)
