"""Where the kernel points of KPConv sit (Thomas et al., ICCV 2019, section 3.2 and supplement)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

STARTS = 8  # random starts; the lowest minimum is kept


@lru_cache(maxsize=4)
def kernel_points(count: int) -> Float[np.ndarray, 'k 3']:
    """Spread points around a fixed one at the origin, the first; mean distance of the others 1.

    They minimise the paper's potential: every point repels every other by 1 / distance, and the
    centre attracts each by its squared distance. The array is shared: do not write to it.

    Args:
        count: points, the centre among them.
    """
    if count == 1:
        return np.zeros((1, 3))
    rng = np.random.default_rng(0)  # another seed gives another orientation
    found = [
        minimize(_potential, rng.normal(size=3 * (count - 1)), jac=True, options={'gtol': 1e-6})
        for _ in range(STARTS)
    ]
    best = min(found, key=lambda result: float(result.fun)).x.reshape(-1, 3)
    scaled = best / np.linalg.norm(best, axis=1).mean()
    return np.concatenate([np.zeros((1, 3)), scaled])


def _potential(flat: Float[np.ndarray, ' m']) -> tuple[float, Float[np.ndarray, ' m']]:
    """Energy and its gradient; the fixed centre repels as well."""
    points = flat.reshape(-1, 3)
    others = np.concatenate([np.zeros((1, 3)), points])
    offset = points[:, None] - others[None]
    distance = np.linalg.norm(offset, axis=2)
    np.fill_diagonal(distance[:, 1:], np.inf)
    centre, mutual = 1 / distance[:, 0], 1 / distance[:, 1:]
    energy = (points**2).sum() + centre.sum() + 0.5 * mutual.sum()
    gradient = 2 * points - (offset / distance[..., None] ** 3).sum(1)
    return float(energy), gradient.ravel()
