"""Where the kernel points of KPConv sit (Thomas et al., ICCV 2019, section 3.2 and supplement)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int64
from scipy.optimize import minimize

QUARTERS = 4  # points of an orbit
STARTS = 8  # random starts; the lowest minimum is kept


@lru_cache(maxsize=4)
def kernel_points(count: int, *, in_orbits: bool = False) -> Float[np.ndarray, 'k 3']:
    """Spread points around a fixed one at the origin, the first; mean distance of the others 1.

    They minimise the paper's potential: every point repels every other by 1 / distance, and the
    centre attracts each by its squared distance. The array is shared: do not write to it.

    Args:
        count: points, the centre among them.
        in_orbits: a quarter turn about z takes the points to each other: what is left after the
            centre and as many fours as there are lies on the axis, then come the fours, each
            point a quarter turn after the one before.
    """
    if count == 1:
        return np.zeros((1, 3))
    free = _orbits(count - 1) if in_orbits else np.eye(3 * (count - 1))
    rng = np.random.default_rng(0)  # another seed gives another orientation
    found = [
        minimize(
            _potential, rng.normal(size=free.shape[1]), free, jac=True, options={'gtol': 1e-6}
        )
        for _ in range(STARTS)
    ]
    best = (free @ min(found, key=lambda result: float(result.fun)).x).reshape(-1, 3)
    scaled = best / np.linalg.norm(best, axis=1).mean()
    return np.concatenate([np.zeros((1, 3)), scaled])


def points_turned_back(count: int, turns: int) -> list[Int64[np.ndarray, ' k']]:
    """Kernel point, of those in orbits, that each comes from under 0, 1, ... quarter turns."""
    alone = 1 + (count - 1) % QUARTERS
    orbit, place = np.divmod(np.arange(count - alone), QUARTERS)
    return [
        np.concatenate([np.arange(alone), alone + orbit * QUARTERS + (place - turn) % QUARTERS])
        for turn in range(turns)
    ]


def _orbits(count: int) -> Float[np.ndarray, 'm v']:
    """What takes heights on the axis, then the first point of each orbit, to all coordinates."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    orbits, alone = divmod(count, QUARTERS)
    every = np.zeros((3 * count, alone + 3 * orbits))
    every[3 * np.arange(alone) + 2, np.arange(alone)] = 1.0
    for orbit in range(orbits):
        rows, columns = 3 * (alone + QUARTERS * orbit), alone + 3 * orbit
        for place in range(QUARTERS):
            at = slice(rows + 3 * place, rows + 3 * place + 3)
            every[at, columns : columns + 3] = np.linalg.matrix_power(turn, place)
    return every


def _potential(
    values: Float[np.ndarray, ' v'], free: Float[np.ndarray, 'm v']
) -> tuple[float, Float[np.ndarray, ' v']]:
    """Energy of the points `free @ values`, and its gradient; the fixed centre repels as well."""
    points = (free @ values).reshape(-1, 3)
    others = np.concatenate([np.zeros((1, 3)), points])
    offset = points[:, None] - others[None]
    distance = np.linalg.norm(offset, axis=2)
    np.fill_diagonal(distance[:, 1:], np.inf)
    centre, mutual = 1 / distance[:, 0], 1 / distance[:, 1:]
    energy = (points**2).sum() + centre.sum() + 0.5 * mutual.sum()
    gradient = 2 * points - (offset / distance[..., None] ** 3).sum(1)
    return float(energy), free.T @ gradient.ravel()
