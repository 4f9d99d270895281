"""What each vehicle's own odometry adds: one time for both clouds, and the pose in between.

If M_v is the motion of vehicle v's LiDAR from time 0 to time 1, expressed in its frame at time 0,
then T_target_source(1) = M_target^-1 @ T_target_source(0) @ M_source.
Errors are six numbers: a shift of the translation, then a small turn from the left, both about
the target's axes; covariances likewise.

Odometry goes wrong by a share of the way: its scale and its heading are off by an amount that
stays, so that the deviation grows with the way driven since the last registration, not with its
root, and however many steps the way came in. A random walk would be rate independent too, but
odometry is judged, and wrong, in metres a metre.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gcl_core import se3
from gcl_ros.odometry import STILL, Motion, Odometry, Pose

GATE = 22.46  # 99.9 % of chi-squared with 6 degrees of freedom
LATELY = 10  # registrations of which it is remembered whether they agreed

Covariance = Float[np.ndarray, '6 6']


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
    relative: Relative, stamp: float, *, source: Motion, target: Motion, drift: Drift
) -> Relative:
    """The relative pose at another time.

    Args:
        relative: at its own time, its covariance that of a registration: what it was carried
            before counts as independent of the way from there.
        stamp: the other time, seconds.
        source: motion of the source's LiDAR in between.
        target: likewise.
        drift: of both odometries.
    """
    back = se3.inverse(target.T)
    T = back @ relative.T_target_source @ source.T
    turn = np.kron(np.eye(2), back[:3, :3])
    # Turning the target turns the errors; the lever of the source's motion adds to the shift.
    lever = relative.T_target_source[:3, :3] @ source.T[:3, 3]
    jacobian = turn @ np.block([[np.eye(3), -_cross(lever)], [np.zeros((3, 3)), np.eye(3)]])
    covariance = jacobian @ relative.covariance @ jacobian.T
    passed = abs(stamp - relative.stamp)
    for driven in (source.driven, target.driven):
        shift = drift.distance * abs(driven) + drift.still * passed
        covariance = covariance + np.diag([shift**2] * 3 + [(drift.turn * driven) ** 2] * 3)
    # The target's own wrong turn swings everything that is far away.
    far = drift.turn * target.driven * _cross(T[:3, 3])
    covariance[:3, :3] += far @ far.T
    return Relative(stamp, T, covariance)


def blurred(
    T: Pose,
    covariance: Covariance,
    *,
    source: Float[np.ndarray, '6'],
    target: Float[np.ndarray, '6'],
) -> Covariance:
    """Covariance of a registration of scans in which motion was left.

    Args:
        T: T_target_source.
        covariance: as if nothing had moved.
        source: what the source moved during its scan, metres along, radians about its own axes: a
            standard deviation, in that direction.
        target: likewise.
    """
    turn = np.kron(np.eye(2), T[:3, :3])
    lever = np.block([[np.eye(3), -_cross(T[:3, 3])], [np.zeros((3, 3)), np.eye(3)]])
    for moved in (turn @ source, lever @ target):
        covariance = covariance + np.outer(moved, moved)
    return covariance


class RelativeFilter:
    """Smooths registrations: each is weighed by its covariance against what odometry expects.

    The estimate is carried from the last registration that agreed in one piece, so that its
    deviation is that of the whole way since. A registration that contradicts it is left out; a
    second one in a row that agrees with the first replaces it.
    """

    def __init__(self, drift: Drift | None = None) -> None:
        self.drift = drift or Drift()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.estimate: Relative | None = None
        self.confirmed: float | None = None  # stamp of the last registration that agreed
        self.contradicted = 0
        self.agreed: deque[bool] = deque(maxlen=LATELY)  # whether the last ones did
        self._anchor: Relative | None = None  # the estimate when it took a registration in
        self._since = STILL, STILL  # motions of source and target from there to the estimate
        self._suspect: Relative | None = None

    def carry(self, stamp: float, *, source: Odometry, target: Odometry) -> bool:
        """Bring the estimate to another time; false, and nothing done, without odometry there."""
        if self.estimate is None:
            return False
        since = self._since_anchor(stamp, source, target)
        if since is None:
            return False
        self._since, self.estimate = since, self._carried(self._anchor, stamp, since)
        return True

    def update(self, measured: Relative, *, source: Odometry, target: Odometry) -> bool:
        """Take a registration, which may be older than the estimate; false if it contradicts."""
        if self.estimate is None:
            return self._begin(measured)
        if measured.stamp > self.estimate.stamp:
            self.carry(measured.stamp, source=source, target=target)
        stamp, latest = max(measured.stamp, self._anchor.stamp), self.estimate.stamp
        since = self._since_anchor(stamp, source, target)
        now = self._moved(measured, stamp, source, target)
        if now is None or since is None:  # no odometry for the time in between
            return self._begin(measured)
        expected = self._carried(self._anchor, stamp, since)
        error = difference(now.T_target_source, expected.T_target_source)
        P, R = expected.covariance, now.covariance
        agrees = bool(error @ np.linalg.solve(P + R, error) <= GATE)
        self.agreed.append(agrees)
        if agrees:
            gain = np.linalg.solve(P + R, P).T
            T = shifted(expected.T_target_source, gain @ error)
            keep = np.eye(6) - gain
            fused = keep @ P @ keep.T + gain @ R @ gain.T
            self._begin(Relative(stamp, T, fused), measured.stamp)
        else:
            self.contradicted += 1
            again = self._moved(self._suspect, stamp, source, target)
            self._suspect = measured
            if again is None:
                return False
            apart = difference(now.T_target_source, again.T_target_source)
            if apart @ np.linalg.solve(again.covariance + R, apart) > GATE:
                return False
            self._begin(now, measured.stamp)
        if latest > stamp:
            self.carry(latest, source=source, target=target)
        return True

    def _begin(self, relative: Relative, confirmed: float | None = None) -> bool:
        self.estimate = self._anchor = relative
        self._since, self._suspect = (STILL, STILL), None
        self.confirmed = relative.stamp if confirmed is None else confirmed
        return True

    def _since_anchor(
        self, stamp: float, source: Odometry, target: Odometry
    ) -> tuple[Motion, Motion] | None:
        """Motions of both from the anchor to a time; step by step, for odometry forgets."""
        steps = _motions(self.estimate.stamp, stamp, source, target)
        if steps is None:
            return None
        return self._since[0].then(steps[0]), self._since[1].then(steps[1])

    def _moved(
        self, relative: Relative | None, stamp: float, source: Odometry, target: Odometry
    ) -> Relative | None:
        motions = relative and _motions(relative.stamp, stamp, source, target)
        return self._carried(relative, stamp, motions) if motions else None

    def _carried(
        self, relative: Relative, stamp: float, motions: tuple[Motion, Motion]
    ) -> Relative:
        source, target = motions
        return carried(relative, stamp, source=source, target=target, drift=self.drift)


def _motions(
    start: float, end: float, source: Odometry, target: Odometry
) -> tuple[Motion, Motion] | None:
    """Of both vehicles between two times; None where odometry does not know."""
    if start == end:
        return STILL, STILL
    first, second = source.moved(start, end), target.moved(start, end)
    return None if first is None or second is None else (first, second)


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
