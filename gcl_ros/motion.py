"""What each vehicle's own odometry adds: one time for both clouds, and the pose in between.

If M_v is the motion of vehicle v's LiDAR from time 0 to time 1, expressed in its frame at time 0,
then T_target_source(1) = M_target^-1 @ T_target_source(0) @ M_source.
Errors are six numbers: a shift of the translation, then a small turn from the left, both about
the target's axes; covariances likewise.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from gcl_core import se3
from gcl_ros.limits import MAX_POSES
from gcl_ros.pairing import JUMP

MAX_GAP = 0.5  # seconds between two poses that are interpolated
KEPT = 30.0  # seconds of odometry
GATE = 22.46  # 99.9 % of chi-squared with 6 degrees of freedom

Pose = Float[np.ndarray, '4 4']
Covariance = Float[np.ndarray, '6 6']


class Odometry:
    """The latest poses of one LiDAR in its odometry frame.

    Args:
        mount: T_base_lidar, where odometry is of the vehicle's base.
    """

    def __init__(self, mount: Pose | None = None) -> None:
        self._mount = np.eye(4) if mount is None else mount
        self._stamps: list[float] = []
        self._poses: list[Pose] = []

    def add(self, stamp: float, T_odom_base: Pose) -> None:
        """Take a pose; a jump back in time forgets the others, disorder is left out."""
        if self._stamps and stamp < self._stamps[-1] - JUMP:
            self._stamps, self._poses = [], []
        if self._stamps and stamp <= self._stamps[-1]:
            return
        self._stamps.append(stamp)
        self._poses.append(T_odom_base @ self._mount)
        while self._stamps[0] < stamp - KEPT or len(self._stamps) > MAX_POSES:
            del self._stamps[0], self._poses[0]

    @property
    def newest(self) -> float | None:
        """Stamp of the last pose; None without any."""
        return self._stamps[-1] if self._stamps else None

    def at(self, stamp: float) -> Pose | None:
        """T_odom_lidar, interpolated; None outside what is known and in gaps of it."""
        after = bisect_left(self._stamps, stamp)
        if after < len(self._stamps) and self._stamps[after] == stamp:
            return self._poses[after]
        if not 0 < after < len(self._stamps):
            return None
        ends = self._stamps[after - 1 : after + 1]
        if ends[1] - ends[0] > MAX_GAP:
            return None
        return interpolated(stamp, ends, self._poses[after - 1 : after + 1])

    def moved(self, start: float, end: float) -> Pose | None:
        """Pose at `end` in the frame at `start`; None where either is not known."""
        before, after = self.at(start), self.at(end)
        return None if before is None or after is None else se3.inverse(before) @ after


def interpolated(stamp: float, ends: Sequence[float], poses: Sequence[Pose]) -> Pose:
    """Pose at a time between those of two, seconds."""
    share = (stamp - ends[0]) / (ends[1] - ends[0])
    turns = Rotation.from_matrix(np.stack([pose[:3, :3] for pose in poses]))
    where = (1 - share) * poses[0][:3, 3] + share * poses[1][:3, 3]
    return se3.from_rotation_translation(Slerp(ends, turns)(stamp).as_matrix(), where)


@dataclass(frozen=True)
class Relative:
    """Where the source stands in the target's frame at one time.

    Attributes:
        stamp: seconds.
        T_target_source: pose.
        covariance: of it.
    """

    stamp: float
    T_target_source: Pose
    covariance: Covariance


@dataclass(frozen=True)
class Drift:
    """Standard deviation that odometry adds for what it measures.

    Attributes:
        distance: metres a metre driven.
        turn: radians a metre driven.
        still: metres a second, moving or not; also for what odometry does not see.
    """

    distance: float = 0.02
    turn: float = 0.002
    still: float = 0.01


def carried(
    relative: Relative, stamp: float, *, source: Pose, target: Pose, drift: Drift
) -> Relative:
    """The relative pose at another time.

    Args:
        relative: at its own time.
        stamp: the other time, seconds.
        source: motion of the source's LiDAR in between, in its frame at the first time.
        target: likewise.
        drift: of both odometries.
    """
    back = se3.inverse(target)
    T = back @ relative.T_target_source @ source
    turn = np.kron(np.eye(2), back[:3, :3])
    # Turning the target turns the errors; the lever of the source's motion adds to the shift.
    lever = relative.T_target_source[:3, :3] @ source[:3, 3]
    jacobian = turn @ np.block([[np.eye(3), -_cross(lever)], [np.zeros((3, 3)), np.eye(3)]])
    covariance = jacobian @ relative.covariance @ jacobian.T
    passed = abs(stamp - relative.stamp)
    for driven in (np.linalg.norm(source[:3, 3]), np.linalg.norm(target[:3, 3])):
        shift = drift.distance * driven + drift.still * passed
        covariance = covariance + np.diag([shift**2] * 3 + [(drift.turn * driven) ** 2] * 3)
    # The target's own wrong turn swings everything that is far away.
    swing = drift.turn * float(np.linalg.norm(target[:3, 3]))
    far = _cross(T[:3, 3])
    covariance[:3, :3] += swing**2 * far @ far.T
    return Relative(stamp, T, covariance)


class RelativeFilter:
    """Smooths registrations: each is weighed by its covariance against what odometry expects.

    A registration that contradicts the estimate is left out; a second one in a row that agrees
    with the first replaces the estimate.
    """

    def __init__(self, drift: Drift | None = None) -> None:
        self.drift = drift or Drift()
        self.estimate: Relative | None = None
        self.confirmed: float | None = None  # stamp of the last registration that agreed
        self.contradicted = 0
        self._suspect: Relative | None = None

    def reset(self) -> None:
        """Forget everything."""
        self.estimate = self._suspect = self.confirmed = None
        self.contradicted = 0

    def carry(self, stamp: float, *, source: Odometry, target: Odometry) -> bool:
        """Bring the estimate to another time; false, and nothing done, without odometry there."""
        moved = self._moved(self.estimate, stamp, source, target)
        if moved is None:
            return False
        self.estimate = moved
        return True

    def update(self, measured: Relative, *, source: Odometry, target: Odometry) -> bool:
        """Take a registration, which may be older than the estimate; false if it contradicts."""
        if self.estimate is None:
            return self._begin(measured)
        if measured.stamp > self.estimate.stamp:
            self.carry(measured.stamp, source=source, target=target)
        now = self._moved(measured, self.estimate.stamp, source, target)
        if now is None:  # no odometry for the time in between
            return self._begin(measured)
        error = difference(now.T_target_source, self.estimate.T_target_source)
        P, R = self.estimate.covariance, now.covariance
        if error @ np.linalg.solve(P + R, error) <= GATE:
            gain = np.linalg.solve(P + R, P).T
            T = shifted(self.estimate.T_target_source, gain @ error)
            keep = np.eye(6) - gain
            fused = keep @ P @ keep.T + gain @ R @ gain.T
            self.estimate = Relative(now.stamp, T, fused)
            self.confirmed, self._suspect = measured.stamp, None
            return True
        self.contradicted += 1
        again = self._moved(self._suspect, now.stamp, source, target)
        self._suspect = measured
        if again is not None:
            apart = difference(now.T_target_source, again.T_target_source)
            if apart @ np.linalg.solve(again.covariance + R, apart) <= GATE:
                return self._begin(now, measured.stamp)
        return False

    def _begin(self, relative: Relative, confirmed: float | None = None) -> bool:
        self.estimate, self._suspect = relative, None
        self.confirmed = relative.stamp if confirmed is None else confirmed
        return True

    def _moved(
        self, relative: Relative | None, stamp: float, source: Odometry, target: Odometry
    ) -> Relative | None:
        if relative is None or relative.stamp == stamp:
            return relative
        motions = [vehicle.moved(relative.stamp, stamp) for vehicle in (source, target)]
        if motions[0] is None or motions[1] is None:
            return None
        return carried(relative, stamp, source=motions[0], target=motions[1], drift=self.drift)


def difference(T: Pose, other: Pose) -> Float[np.ndarray, '6']:
    """Six numbers that `shifted` takes from the other pose to this."""
    turn = Rotation.from_matrix(T[:3, :3] @ other[:3, :3].T).as_rotvec()
    return np.concatenate([T[:3, 3] - other[:3, 3], turn])


def shifted(T: Pose, error: Float[np.ndarray, '6']) -> Pose:
    """Shift the translation and turn from the left."""
    turn = Rotation.from_rotvec(error[3:]).as_matrix()
    return se3.from_rotation_translation(turn @ T[:3, :3], T[:3, 3] + error[:3])


def _cross(v: Float[np.ndarray, '3']) -> Float[np.ndarray, '3 3']:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
