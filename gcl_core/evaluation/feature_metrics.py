"""How good features are before any estimator: inliers, feature-match recall, feature drift."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from jaxtyping import Float

from gcl_core.types import Correspondences, PositiveGroups

TAU1 = 0.6  # metres: two voxels of 0.3 m, as the paper's 0.1 m at 0.05 m (table of ETH)
TAU2 = 0.05  # share of inliers; paper, table of ETH


def inlier_ratio(
    matches: Correspondences, T_target_source: Float[np.ndarray, '4 4'], tau1: float = TAU1
) -> float:
    """Share of matches that the true transform brings within `tau1` metres of each other.

    0 without matches: none of them is right.
    """
    if len(matches) == 0:
        return 0.0
    T = torch.from_numpy(T_target_source).to(matches.source.dtype)
    moved = matches.source @ T[:3, :3].t() + T[:3, 3]
    return float(((moved - matches.target).norm(dim=1) <= tau1).float().mean())


def feature_match_recall(ratios: Iterable[float], tau2: float = TAU2) -> tuple[int, int]:
    """Count pairs with an inlier ratio above `tau2`, and all pairs.

    Their quotient is the feature-match recall, FMR (paper, appendix, "Generalization to ETH").

    Args:
        ratios: of `inlier_ratio`, one a pair.
        tau2: share of inliers from which a robust estimator has a chance.
    """
    above = [ratio > tau2 for ratio in ratios]
    return sum(above), len(above)


def feature_drift(
    descriptors: Float[torch.Tensor, 'n d'], groups: PositiveGroups
) -> Float[torch.Tensor, ' m']:
    """Distance of each member's feature from the one of its spot's finest observation.

    Paper, section "Analysis", "Feature drift and its correlation with density", where the densest
    observation is the finest: see `figures.sampling.densest`. The finest member's own drift is 0.

    Args:
        descriptors: of all scans stacked, as `groups.member` counts them.
        groups: spots.
    """
    finest = groups.member[groups.finest][groups.group]
    return (descriptors[groups.member] - descriptors[finest]).norm(dim=1)
