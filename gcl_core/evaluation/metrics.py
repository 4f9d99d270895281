"""Errors of a transform, recall and its interval (paper, section "Metrics")."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcl_core import se3


@dataclass(frozen=True)
class Criterion:
    """A pair is registered when both errors are at most these."""

    rte: float
    rre_deg: float


STRICT = Criterion(rte=0.6, rre_deg=1.5)
LOOSE = Criterion(rte=2.0, rre_deg=5.0)


def rte(T_estimated: Float[np.ndarray, '4 4'], T_true: Float[np.ndarray, '4 4']) -> float:
    """Relative translation error: distance between the two translations, metres."""
    return float(np.linalg.norm(T_estimated[:3, 3] - T_true[:3, 3]))


def rre_deg(T_estimated: Float[np.ndarray, '4 4'], T_true: Float[np.ndarray, '4 4']) -> float:
    """Relative rotation error: geodesic angle between the two rotations, degrees."""
    return math.degrees(se3.rotation_angle(se3.inverse(T_true) @ T_estimated))


def registered(
    T_estimated: Float[np.ndarray, '4 4'] | None,
    T_true: Float[np.ndarray, '4 4'],
    criterion: Criterion,
) -> bool:
    """Whether an estimate meets a criterion; no estimate does not."""
    if T_estimated is None:
        return False
    return (
        rte(T_estimated, T_true) <= criterion.rte
        and rre_deg(T_estimated, T_true) <= criterion.rre_deg
    )


def wilson(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a proportion (Wilson, 1927); (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    share = successes / trials
    centre = share + z**2 / (2 * trials)
    spread = z * math.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2))
    scale = 1 + z**2 / trials
    return max(0.0, (centre - spread) / scale), min(1.0, (centre + spread) / scale)
