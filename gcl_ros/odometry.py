"""The poses of one vehicle's odometry: where its LiDAR was, and how far it drove in between."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.ops.deskew import between
from gcl_ros.limits import MAX_POSES
from gcl_ros.pairing import JUMP

MAX_GAP = 0.5  # seconds between two poses that are interpolated
KEPT = 30.0  # seconds of odometry
RULER = 1.0  # metres: the way is measured in strides of these, or noise would count as driving

Pose = Float[np.ndarray, '4 4']


@dataclass(frozen=True)
class Motion:
    """How one LiDAR moved between two times.

    Attributes:
        T: its pose at the later time in its frame at the earlier one.
        driven: metres of its way; negative back in time.
    """

    T: Pose
    driven: float

    def then(self, other: Motion) -> Motion:
        """This motion and one that follows it."""
        return Motion(self.T @ other.T, self.driven + other.driven)


STILL = Motion(np.eye(4), 0.0)


class Odometry:
    """The latest poses of one LiDAR in its odometry frame.

    Args:
        mount: T_base_lidar, where odometry is of the vehicle's base.
    """

    def __init__(self, mount: Pose | None = None) -> None:
        self._mount = np.eye(4) if mount is None else mount
        self._forget()

    def _forget(self) -> None:
        self._stamps: list[float] = []
        self._poses: list[Pose] = []
        self._driven: list[float] = []  # metres, at each pose
        self._corner = np.zeros(3), 0.0  # end of the last stride, and the way until there

    def add(self, stamp: float, T_odom_base: Pose) -> None:
        """Take a pose; a jump back in time forgets the others, disorder is left out."""
        if self._stamps and stamp < self._stamps[-1] - JUMP:
            self._forget()
        if self._stamps and stamp <= self._stamps[-1]:
            return
        pose = T_odom_base @ self._mount
        if not self._stamps:
            self._corner = pose[:3, 3], 0.0
        driven = self._corner[1] + float(np.linalg.norm(pose[:3, 3] - self._corner[0]))
        if driven - self._corner[1] >= RULER:
            self._corner = pose[:3, 3], driven
        self._stamps.append(stamp)
        self._poses.append(pose)
        self._driven.append(driven)
        while self._stamps[0] < stamp - KEPT or len(self._stamps) > MAX_POSES:
            del self._stamps[0], self._poses[0], self._driven[0]

    @property
    def known(self) -> tuple[float, float] | None:
        """Stamps of the first and the last pose; None without any."""
        return (self._stamps[0], self._stamps[-1]) if self._stamps else None

    @property
    def newest(self) -> float | None:
        """Stamp of the last pose; None without any."""
        return self._stamps[-1] if self._stamps else None

    def at(self, stamp: float) -> Pose | None:
        """T_odom_lidar, interpolated; None outside what is known and in gaps of it."""
        moved = self._at(stamp)
        return None if moved is None else moved.T

    def _at(self, stamp: float) -> Motion | None:
        """Pose in the odometry frame, and the way until there."""
        after = bisect_left(self._stamps, stamp)
        if after < len(self._stamps) and self._stamps[after] == stamp:
            return Motion(self._poses[after], self._driven[after])
        if not 0 < after < len(self._stamps):
            return None
        ends = self._stamps[after - 1 : after + 1]
        if ends[1] - ends[0] > MAX_GAP:
            return None
        driven = float(np.interp(stamp, ends, self._driven[after - 1 : after + 1]))
        return Motion(interpolated(stamp, ends, self._poses[after - 1 : after + 1]), driven)

    def moved(self, start: float, end: float) -> Motion | None:
        """Motion from one time to another; None where either is not known."""
        before, after = self._at(start), self._at(end)
        if before is None or after is None:
            return None
        return Motion(se3.inverse(before.T) @ after.T, after.driven - before.driven)

    def over(self, start: float, end: float) -> tuple[list[float], list[Pose]]:
        """Stamps and poses from the last before a span of time to the first after it."""
        first = max(bisect_left(self._stamps, start) - 1, 0)
        last = bisect_left(self._stamps, end) + 1
        return self._stamps[first:last], self._poses[first:last]

    def pace(self, stamp: float, span: float) -> Pose | None:
        """Motion in so many seconds from a time, or at the pace that is known nearest to it.

        None where nothing is known within a second of it.
        """
        if self.known is None:
            return None
        first, last = self.known
        start = min(max(stamp, first), max(last - span, first))
        end = min(start + span, last)
        moved = self.moved(start, end)
        if moved is None or start == end or abs(start - stamp) > JUMP + span:
            return None
        return between(np.eye(4), moved.T, span / (end - start))


def interpolated(stamp: float, ends: Sequence[float], poses: Sequence[Pose]) -> Pose:
    """Pose at a time between those of two, seconds."""
    return between(poses[0], poses[1], (stamp - ends[0]) / (ends[1] - ends[0]))
