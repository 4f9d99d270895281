"""Random turns and tilts of scans, remembered so that the ground truth follows."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.types import PointCloud


def random_turn(
    rng: np.random.Generator, *, shared_yaw: float, yaw_range: float, tilt_range: float
) -> Float[np.ndarray, '4 4']:
    """Draw `T_augmented_lidar`: a heading and a tilt, no translation.

    Args:
        rng: source of randomness.
        shared_yaw: heading common to all scans of a group, radians; turns the street.
        yaw_range: half width of each scan's own heading, radians; turns a scan against the others.
        tilt_range: half width of roll and pitch, radians.
    """
    roll, pitch = rng.uniform(-tilt_range, tilt_range, 2)
    yaw = shared_yaw + rng.uniform(-yaw_range, yaw_range)
    return se3.from_xyz_rpy(roll=roll, pitch=pitch, yaw=yaw)


def thin_out(cloud: PointCloud, share: float, rng: np.random.Generator) -> PointCloud:
    """Keep a random `share` of the points, at least one."""
    count = max(1, round(share * len(cloud)))
    return PointCloud(cloud.points[np.sort(rng.permutation(len(cloud))[:count])])
