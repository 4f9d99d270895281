"""GICP on the full scans, from coarse to fine, with a check that it did not walk away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import small_gicp
import torch
from jaxtyping import Float, Float32

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.crop import meeting
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud

MAX_RANGE = 80.0  # metres
NEIGHBORS = 10  # that a covariance is estimated from (small_gicp's default for whole scans)
MARGIN = 1.5  # reaches around a scan that the other's points are kept in: it moves a little
FEWEST = 20  # points of a scan that meet the other's; fewer refine nothing


# Horizontal information in the weakest direction over that in the strongest: right transforms of
# simulated streets had 0.037 or more, smooth tunnels 0.006 or less.
FIRM = 0.015


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

    resolution: tuple[float, ...] = (1.0, 0.5)
    reach: tuple[float, ...] = (2.0, 0.8)
    iterations: int = 10
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
        residual: mean squared residual of the last step's correspondences, in units of the
            points' covariances.
    """

    T_target_source: Float[np.ndarray, '4 4']
    information: Float[np.ndarray, '6 6']
    walked: bool
    residual: float = 0.0

    @property
    def slides(self) -> bool:
        """Whether nothing holds the transform in some horizontal direction, as in a tunnel."""
        ground, rest = self.information[:2], self.information[2:]
        held = ground[:, :2] - ground[:, 2:] @ np.linalg.solve(
            rest[:, 2:] + 1e-6 * np.eye(4), rest[:, :2]
        )
        weakest, strongest = np.linalg.eigvalsh(held)
        return bool(weakest < FIRM * strongest)


Prepared = list[Float32[np.ndarray, 'n 3']]  # a scan's points, thinned for each step


def prepare(cloud: PointCloud, config: RefineConfig) -> Prepared:
    """Thin a scan, once per scan; a coarser step's points come from the finer one's.

    Raises:
        GclError: no point lies within 80 m.
    """
    thinned = {}
    for resolution in sorted(config.resolution):
        points = voxelize([cloud], voxel_size=resolution, max_range=MAX_RANGE).points
        thinned[resolution] = points.numpy()
        cloud = PointCloud(points.numpy())
    return [thinned[resolution] for resolution in config.resolution]


def refine(
    T_target_source: Float[np.ndarray, '4 4'],
    *,
    source: Prepared,
    target: Prepared,
    config: RefineConfig,
) -> Refined:
    """Refine a transform; return it unchanged if GICP leaves its neighbourhood."""
    return refine_all([T_target_source], source=source, target=target, config=config)[0]


def refine_all(
    T_target_source: Sequence[Float[np.ndarray, '4 4']],
    *,
    source: Prepared,
    target: Prepared,
    config: RefineConfig,
) -> list[Refined]:
    """Refine several transforms of a pair; they share what is prepared for each step."""
    current = [Refined(T, np.eye(6), walked=False) for T in T_target_source]
    for points, target_points, reach in zip(source, target, config.reach):
        going = [r.T_target_source for r in current if not r.walked]
        met = meeting(points, target_points, going, MARGIN * reach)
        if min(map(len, met)) < FEWEST:
            continue
        (moved, _), still = map(_with_covariances, met)
        for i, (start, now) in enumerate(zip(T_target_source, current)):
            if not now.walked:
                current[i] = _align(start, now.T_target_source, moved, *still, reach, config)
    return current


def _with_covariances(
    points: Float32[np.ndarray, 'n 3'],
) -> tuple[small_gicp.PointCloud, small_gicp.KdTree]:
    cloud = small_gicp.PointCloud(points.astype(np.float64))
    tree = small_gicp.KdTree(cloud)
    # A covariance depends on its own point alone: threads do not change it.
    small_gicp.estimate_covariances(cloud, tree, NEIGHBORS, torch.get_num_threads())
    return cloud, tree


def _align(
    start: Float[np.ndarray, '4 4'],
    now: Float[np.ndarray, '4 4'],
    source: small_gicp.PointCloud,
    target: small_gicp.PointCloud,
    tree: small_gicp.KdTree,
    reach: float,
    config: RefineConfig,
) -> Refined:
    """Go one step of GICP from `now`; go back to `start` if it leads too far away from there."""
    result = small_gicp.align(
        target,
        source,
        tree,
        init_T_target_source=now,
        registration_type='GICP',
        max_correspondence_distance=reach,
        num_threads=config.threads,
        max_iterations=config.iterations,
    )
    T, information = np.asarray(result.T_target_source), np.asarray(result.H)
    if walked(start, T, config) or not np.isfinite(information).all():
        return Refined(start, np.eye(6), walked=True)
    residual = float(result.error) / max(1, int(result.num_inliers))
    return Refined(T, _in_target_frame(information, T), False, residual)


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
