"""Undo the vehicle's motion during a scan, where points tell their times.

At 20 m/s a scan of 0.1 s is 2 m long. Known fields: `t` (Ouster), `time` (Velodyne), `timestamp`
(Hesai, RoboSense), `offset_time` (Livox). Integers count nanoseconds, floats seconds; a field of
large floats counts from the epoch, the others from the stamp of the header.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.types import PointCloud
from gcl_ros.conversions import column, every_point, finite, kept, name_of, seconds
from gcl_ros.motion import Odometry

TIMES = ('t', 'time', 'timestamp', 'offset_time')
LONGEST = 1.0  # seconds before or after the header's stamp
STEP = 0.005  # seconds that points are moved alike


def point_times(message: Any) -> np.ndarray | None:
    """Seconds of each point after the stamp of the header; None where points do not tell.

    The message must have passed `every_point`.
    """
    field = next((f for f in message.fields if f.name in TIMES and f.count <= 1), None)
    if field is None:
        return None
    values = column(message, field, name_of(message)).reshape(-1)
    times = values.astype(np.float64)
    if values.dtype.kind in 'iu':
        times *= 1e-9
    elif np.nanmax(times, initial=0.0) > 1e6:
        times -= seconds(message.header.stamp)
    within = np.abs(times) <= LONGEST
    return times if within.all() else None  # times of some other meaning


def deskewed(message: Any, odometry: Odometry) -> PointCloud | None:
    """The cloud as if seen at once, at the stamp of its header.

    Args:
        message: sensor_msgs/PointCloud2.
        odometry: of the LiDAR that saw it.

    Returns:
        None where points have no times, or odometry does not cover them.

    Raises:
        GclError: as `gcl_ros.conversions.point_cloud`.
    """
    points = every_point(message)
    times = point_times(message)
    if times is None:
        return None
    stamp = seconds(message.header.stamp)
    step = np.round(times / STEP).astype(int)
    moved = np.empty_like(points)
    for k in np.unique(step):
        motion = odometry.moved(stamp, stamp + k * STEP)
        if motion is None:
            return None
        moved[step == k] = se3.transform(motion, points[step == k])
    return kept(moved, finite(moved), message)
