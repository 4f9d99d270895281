"""KISS-Matcher's solver, where its package is installed (`pip install kiss-matcher`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.support import Support
from gcl_core.types import Correspondences


@dataclass(frozen=True)
class KissMatcherConfig:
    """Settings of KISS-Matcher (Lim et al., 2025).

    Attributes:
        threshold: its voxel size, from which it derives its noise bounds, metres.
        level: yaw and translation only (its Quatro solver).
    """

    threshold: float = 0.8
    level: bool = True


def kiss_matcher(
    correspondences: Correspondences, config: KissMatcherConfig, *, max_yaw: float = math.pi
) -> list[Hypothesis]:
    """Prune correspondences by their graph and solve; one hypothesis or none.

    Raises:
        GclError: the package is not installed.
    """
    try:
        import kiss_matcher as kiss
    except ImportError:
        raise GclError(
            'estimator kiss_matcher needs its package: pip install kiss-matcher'
        ) from None
    if len(correspondences) < 3:
        return []
    matcher = kiss.KISSMatcher(
        kiss.KISSMatcherConfig(voxel_size=config.threshold, use_quatro=config.level)
    )
    source, target = (
        [column.reshape(3, 1) for column in side.numpy()]
        for side in (correspondences.source, correspondences.target)
    )
    solution = matcher.prune_and_solve(source, target)
    T = se3.from_rotation_translation(
        np.asarray(solution.rotation), np.asarray(solution.translation)
    )
    if not solution.valid or abs(se3.yaw(T)) > max_yaw:
        return []
    return Support(correspondences, config.threshold).polish(torch.from_numpy(T)[None], steps=0)
