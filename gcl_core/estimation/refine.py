"""GICP on the full scans, from coarse to fine, with a check that it did not walk away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import PointCloud


@dataclass(frozen=True)
class RefineConfig:
    """How far and how finely GICP may pull.

    Attributes:
        resolution: scans are thinned to this spacing for each step, coarse to fine, metres.
        reach: correspondence distance of each step, metres.
        iterations: most iterations of each step.
        max_move: a result that moved further than this is discarded, metres.
        max_turn_deg: the same for its rotation, degrees.
        threads: of small_gicp; more than one changes the last bits from run to run.
    """

    resolution: tuple[float, ...] = (0.8, 0.3)
    reach: tuple[float, ...] = (2.0, 0.8)
    iterations: int = 20
    max_move: float = 3.0
    max_turn_deg: float = 6.0
    threads: int = 1

    def __post_init__(self) -> None:
        if len(self.resolution) != len(self.reach):
            raise GclError(
                f'refine.resolution has {len(self.resolution)} steps, refine.reach '
                f'{len(self.reach)}; give one of each for every step'
            )


@dataclass(frozen=True)
class Refined:
    """A refined transform.

    Attributes:
        T_target_source: the unrefined one if GICP walked away.
        information: of translation and rotation (x y z rot_x rot_y rot_z, about the target's
            axes, at the transform's own origin), from GICP's last step; not scaled to metres.
        walked: whether GICP left the neighbourhood of the start.
    """

    T_target_source: Float[np.ndarray, '4 4']
    information: Float[np.ndarray, '6 6']
    walked: bool


Prepared = list[tuple[object, object]]


def prepare(cloud: PointCloud, config: RefineConfig) -> Prepared:
    """Thin a scan and estimate its covariances, once per scan; points and tree of each step."""
    return [
        small_gicp.preprocess_points(
            cloud.points.astype(np.float64),
            downsampling_resolution=resolution,
            num_threads=config.threads,
        )
        for resolution in config.resolution
    ]


def refine(
    T_target_source: Float[np.ndarray, '4 4'],
    *,
    source: Prepared,
    target: Prepared,
    config: RefineConfig,
) -> Refined:
    """Refine a transform; return it unchanged if GICP leaves its neighbourhood."""
    refined, information = T_target_source, np.eye(6)
    for (points, _), (target_points, tree), reach in zip(source, target, config.reach):
        result = small_gicp.align(
            target_points,
            points,
            tree,
            init_T_target_source=refined,
            registration_type='GICP',
            max_correspondence_distance=reach,
            num_threads=config.threads,
            max_iterations=config.iterations,
        )
        refined, information = np.asarray(result.T_target_source), np.asarray(result.H)
    if walked(T_target_source, refined, config) or not np.isfinite(information).all():
        return Refined(T_target_source, np.eye(6), walked=True)
    return Refined(refined, _in_target_frame(information, refined), walked=False)


def walked(
    before: Float[np.ndarray, '4 4'], after: Float[np.ndarray, '4 4'], config: RefineConfig
) -> bool:
    """Whether a refinement left its neighbourhood."""
    if not np.isfinite(after).all():
        return True
    moved = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
    turned = np.rad2deg(se3.rotation_angle(se3.inverse(before) @ after))
    return moved > config.max_move or bool(turned > config.max_turn_deg)


def _in_target_frame(
    information: Float[np.ndarray, '6 6'], T: Float[np.ndarray, '4 4']
) -> Float[np.ndarray, '6 6']:
    """From small_gicp's T exp([rotation, translation]) to ROS's order and axes.

    A small motion (w, v) in the source's frame is a rotation R w and a translation R v of T.
    """
    to_source = np.zeros((6, 6))
    to_source[:3, 3:] = to_source[3:, :3] = T[:3, :3].T
    return np.asarray(to_source.T @ information @ to_source)
