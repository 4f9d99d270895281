"""GICP on the full scans, from coarse to fine, with a check that it did not walk away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from jaxtyping import Float

from gcl_core import se3
from gcl_core.types import PointCloud


@dataclass(frozen=True)
class RefineConfig:
    """How far and how finely GICP may pull.

    Attributes:
        resolution: scans are thinned to this spacing, metres.
        reach: correspondence distances, coarse to fine, metres.
        max_move: a result that moved further than this is discarded, metres.
        max_turn_deg: the same for its rotation, degrees.
        threads: of small_gicp; more than one changes the last bits from run to run.
    """

    resolution: float = 0.3
    reach: tuple[float, ...] = (2.0, 0.8)
    max_move: float = 3.0
    max_turn_deg: float = 6.0
    threads: int = 1


def prepare(cloud: PointCloud, config: RefineConfig) -> tuple[object, object]:
    """Thin a scan and estimate its covariances, once per scan; return points and their tree."""
    points, tree = small_gicp.preprocess_points(
        cloud.points.astype(np.float64),
        downsampling_resolution=config.resolution,
        num_threads=config.threads,
    )
    return points, tree


def refine(
    T_target_source: Float[np.ndarray, '4 4'],
    *,
    source: tuple[object, object],
    target: tuple[object, object],
    config: RefineConfig,
) -> Float[np.ndarray, '4 4']:
    """Refine a transform; return it unchanged if GICP leaves its neighbourhood."""
    refined = T_target_source
    for reach in config.reach:
        result = small_gicp.align(
            target[0],
            source[0],
            target[1],
            init_T_target_source=refined,
            registration_type='GICP',
            max_correspondence_distance=reach,
            num_threads=config.threads,
            max_iterations=30,
        )
        refined = np.asarray(result.T_target_source)
    moved = se3.inverse(T_target_source) @ refined
    walked = float(np.linalg.norm(refined[:3, 3] - T_target_source[:3, 3])) > config.max_move
    turned = np.rad2deg(se3.rotation_angle(moved)) > config.max_turn_deg
    return T_target_source if walked or turned or not np.isfinite(refined).all() else refined
