"""Undo the vehicle's motion during a scan, where points tell their times and odometry the motion.

At 20 m/s a scan of 0.1 s is 2 m long. What is not undone is said, and is part of the deviation.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.ops.deskew import deskewed as straightened
from gcl_core.types import PointCloud
from gcl_ros.conversions import every_point, finite, kept, seconds
from gcl_ros.motion import difference
from gcl_ros.odometry import MAX_GAP, Odometry
from gcl_ros.point_times import point_times

SWEEP = 0.1  # seconds of a scan whose points do not tell
STRAY = 0.05  # share of the points that odometry may leave out


@dataclass(frozen=True)
class Swept:
    """A scan that took its time, and what became of the motion meanwhile.

    Attributes:
        cloud: as if seen at once, at the stamp of the header; None where it is taken as it came.
        why: it is taken so; empty where there was nothing to undo or it was undone.
        timeless: points without a time, which stay where they are.
        left: motion that was not undone: metres along, radians about the LiDAR's x, y, z.
        awaits: stamp that odometry has to reach before it can be undone, seconds; None where
            waiting helps nothing.
        by_sender: a compact scan: whatever could be undone was, before it was sent.
    """

    cloud: PointCloud | None = None
    why: str = ''
    timeless: int = 0
    left: Float[np.ndarray, '6'] = field(default_factory=lambda: np.zeros(6))
    awaits: float | None = None
    by_sender: bool = False

    def told(self) -> str:
        """Whether the scan is de-skewed, for the diagnostics."""
        if self.by_sender:
            return 'by its sender, whose diagnostics say whether'
        if self.why:
            return f'no: {self.why}'
        return f'yes, but {self.timeless} points have no time' if self.timeless else 'yes'


def deskewed(message: Any, odometry: Odometry, sweep: float = SWEEP) -> Swept:
    """Bring the points of a cloud to where they are at the stamp of its header.

    Args:
        message: sensor_msgs/PointCloud2.
        odometry: of the LiDAR that saw it.
        sweep: seconds that a scan takes whose points do not tell; 0 if scans come de-skewed, and
            nothing is done.

    Raises:
        GclError: as `gcl_ros.conversions.point_cloud`.
    """
    if sweep == 0:
        return Swept()
    stamp = seconds(message.header.stamp)
    points = every_point(message)
    times = point_times(message, points)
    if times.seconds is None:
        return _as_it_came(times.why, odometry, stamp, sweep)
    after, seen = times.seconds, finite(points) & np.isfinite(times.seconds)
    began, ended = float(after[seen].min()), float(after[seen].max())
    why = _gap(odometry, stamp, stamp + after[seen])
    if why:
        as_it_came = _as_it_came(why, odometry, stamp + began, ended - began)
        return replace(as_it_came, awaits=_awaited(odometry, stamp + max(ended, 0.0)))
    first, last = odometry.known
    after = np.where((stamp + after >= first) & (stamp + after <= last), after, np.nan)
    stamps, poses = odometry.over(stamp + began, stamp + ended)
    back = se3.inverse(odometry.at(stamp))
    moved = straightened(
        points,
        after,
        stamps=np.array(stamps) - stamp,
        T_ref_lidar=np.stack([back @ pose for pose in poses]),
    )
    timeless = int(np.isnan(after[finite(points)]).sum())
    return Swept(kept(moved, finite(moved), message), timeless=timeless)


def _gap(odometry: Odometry, stamp: float, when: Float[np.ndarray, ' n']) -> str:
    """What keeps odometry from telling the motion at some times; empty if it tells it."""
    if odometry.known is None:
        return 'no odometry came'
    first, last = odometry.known
    outside = np.mean((when < first) | (when > last))
    if outside > STRAY or not first <= stamp <= last:
        if last < stamp:
            return f'odometry ends {stamp - last:.3f} s before the stamp of the scan'
        if when.max() > last:
            return f'odometry ends {when.max() - last:.3f} s before the scan does'
        return f'odometry begins {first - min(stamp, when.min()):.3f} s after the scan'
    stamps, _ = odometry.over(min(stamp, when.min()), max(stamp, when.max()))
    widest = max(np.diff(stamps), default=np.inf)
    return f'odometry has a gap of {widest:.2f} s there' if widest > MAX_GAP else ''


def _awaited(odometry: Odometry, end: float) -> float | None:
    """When a scan ends, if odometry has not come so far and is about to."""
    newest = odometry.newest
    return end if newest is not None and 0 < end - newest < MAX_GAP else None


def _as_it_came(why: str, odometry: Odometry, began: float, span: float) -> Swept:
    moved = odometry.pace(began, span)
    if moved is None:
        return Swept(why=why)
    return Swept(why=why, left=difference(moved, np.eye(4)))
