"""Estimators by name: correspondences to hypotheses, best first, each a distinct place."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from gcl_core import se3
from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.kiss_matcher import KissMatcherConfig, kiss_matcher
from gcl_core.estimation.open3d_ransac import Open3dRansacConfig, open3d_ransac
from gcl_core.estimation.ransac import RansacConfig, ransac
from gcl_core.estimation.spatial_consistency import (
    SpatialConsistencyConfig,
    spatial_consistency,
)
from gcl_core.matching.match import finite
from gcl_core.types import Correspondences

ESTIMATORS: dict[str, Callable[..., list[Hypothesis]]] = {
    'ransac': ransac,
    'spatial_consistency': spatial_consistency,
    'open3d_ransac': open3d_ransac,
    'kiss_matcher': kiss_matcher,
}


@dataclass(frozen=True)
class EstimatorConfig:
    """Which estimator, and the settings of each.

    Attributes:
        name: `ransac` is ours, `spatial_consistency` after SC2-PCR, `open3d_ransac` the paper's,
            `kiss_matcher` an optional package.
        ransac: see `RansacConfig`.
        spatial_consistency: see `SpatialConsistencyConfig`.
        open3d_ransac: see `Open3dRansacConfig`.
        kiss_matcher: see `KissMatcherConfig`.
    """

    name: Literal['ransac', 'spatial_consistency', 'open3d_ransac', 'kiss_matcher'] = 'ransac'
    ransac: RansacConfig = field(default_factory=RansacConfig)
    spatial_consistency: SpatialConsistencyConfig = field(default_factory=SpatialConsistencyConfig)
    open3d_ransac: Open3dRansacConfig = field(default_factory=Open3dRansacConfig)
    kiss_matcher: KissMatcherConfig = field(default_factory=KissMatcherConfig)


def estimate(
    correspondences: Correspondences, config: EstimatorConfig, *, max_yaw: float = math.pi
) -> list[Hypothesis]:
    """Search transforms by the named estimator; pairs that are not finite are left out.

    Args:
        correspondences: matches.
        config: see `EstimatorConfig`.
        max_yaw: largest heading of a transform, radians.
    """
    settings = getattr(config, config.name)
    found = ESTIMATORS[config.name](finite(correspondences), settings, max_yaw=max_yaw)
    # A re-estimation may have turned some of them over the limit.
    return [h for h in found if abs(se3.yaw(h.T_target_source.numpy())) <= max_yaw]
