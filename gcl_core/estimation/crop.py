"""Which points of two scans can meet at all: the rest need neither covariances nor a search."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from gcl_core import se3

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
        for axis, row in enumerate((T[:3] / self._reach).astype(points.dtype)):
            offset = row[3] - points.dtype.type(self._low[axis] / self._reach)
            cell = points[:, 0] * row[0] + points[:, 1] * row[1] + points[:, 2] * row[2] + offset
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
    around_source, around_target = Neighborhood(source, reach), Neighborhood(target, reach)
    here = [around_target.holds(source, T) for T in T_target_source]
    there = [around_source.holds(target, se3.inverse(T)) for T in T_target_source]
    return source[np.any(here, axis=0)], target[np.any(there, axis=0)]
