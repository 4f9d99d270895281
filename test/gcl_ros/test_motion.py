"""Odometry and registrations of two driving vehicles, the truth of which is known."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_ros.motion import (
    GATE,
    Drift,
    Odometry,
    Relative,
    RelativeFilter,
    carried,
    difference,
    shifted,
)

NONE = Drift(0.0, 0.0, 0.0)
SMALL = np.diag([0.1**2] * 3 + [0.01**2] * 3)


def driving(stamp: float, side: str) -> np.ndarray:
    """Pose in the world: two vehicles that meet, both in bends."""
    if side == 'target':
        return se3.from_xyz_rpy(x=10 * stamp, y=2 * np.sin(stamp), yaw=0.2 * stamp)
    return se3.from_xyz_rpy(x=60 - 8 * stamp, y=5, z=0.3, roll=0.02, yaw=np.pi - 0.3 * stamp)


def truth(stamp: float) -> np.ndarray:
    return se3.inverse(driving(stamp, 'target')) @ driving(stamp, 'source')


def odometries(until: float) -> dict[str, Odometry]:
    """Each in an odometry frame of its own, 50 Hz."""
    made = {'source': Odometry(), 'target': Odometry()}
    start = {side: se3.inverse(driving(0, side)) for side in made}
    for stamp in np.arange(0, until + 1e-9, 0.02):
        for side, odometry in made.items():
            odometry.add(float(stamp), start[side] @ driving(float(stamp), side))
    return made


def test_odometry_interpolates_and_knows_its_limits():
    odometry = Odometry(mount=se3.from_xyz_rpy(z=1.8))
    assert odometry.newest is None
    assert odometry.at(0.0) is None
    for i in range(3):
        odometry.add(1.0 + 0.1 * i, se3.from_xyz_rpy(x=i, yaw=0.2 * i))
    np.testing.assert_allclose(odometry.at(1.05), se3.from_xyz_rpy(x=0.5, z=1.8, yaw=0.1))
    assert odometry.at(0.9) is None
    assert odometry.at(1.3) is None
    odometry.add(2.0, np.eye(4))
    assert odometry.at(1.6) is None  # a gap
    odometry.add(1.9, np.eye(4))  # out of order
    assert odometry.newest == 2.0
    odometry.add(0.5, np.eye(4))  # the bag starts again
    assert odometry.newest == 0.5
    assert odometry.at(1.05) is None


@pytest.mark.parametrize(('start', 'end'), [(0.1, 1.5), (1.5, 0.1)])
def test_a_pose_is_carried_to_another_time(start, end):
    made = odometries(2.0)
    motions = {side: made[side].moved(start, end) for side in made}
    there = carried(Relative(start, truth(start), SMALL), end, **motions, drift=NONE)
    np.testing.assert_allclose(there.T_target_source, truth(end), atol=1e-9)


def test_the_covariance_that_is_carried_is_that_of_samples():
    made, rng = odometries(2.0), np.random.default_rng(0)
    motions = {side: made[side].moved(0.1, 1.5) for side in made}
    root = rng.normal(size=(6, 6)) * [0.03] * 6
    root[:, 3:] *= 0.03
    there = carried(Relative(0.1, truth(0.1), root.T @ root), 1.5, **motions, drift=NONE)
    errors = []
    for move in rng.normal(size=(3000, 6)) @ root:
        wrong = Relative(0.1, shifted(truth(0.1), move), SMALL)
        moved = carried(wrong, 1.5, **motions, drift=NONE).T_target_source
        errors.append(difference(moved, there.T_target_source))
    expected = np.cov(np.array(errors).T)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((there.covariance - expected) / scale).max() < 0.1


def test_the_filter_is_better_than_its_measurements_and_honest():
    """Late registrations at 2 Hz; the error stays what the covariance says."""
    made, rng = odometries(6.0), np.random.default_rng(1)
    track, errors, measured, scores = RelativeFilter(), [], [], []
    for stamp in np.arange(0.5, 5.5, 0.5):
        noise = rng.normal(size=6) * np.sqrt(np.diag(SMALL))
        assert track.update(Relative(stamp, shifted(truth(stamp), noise), SMALL), **made)
        assert track.carry(stamp + 0.3, **made)
        error = difference(track.estimate.T_target_source, truth(stamp + 0.3))
        errors.append(np.linalg.norm(error[:3]))
        measured.append(np.linalg.norm(noise[:3]))
        scores.append(error @ np.linalg.solve(track.estimate.covariance, error))
    assert np.mean(errors[5:]) < np.mean(measured)
    assert max(scores) < GATE


def test_one_wrong_registration_is_left_out_and_two_that_agree_replace():
    made, track = odometries(6.0), RelativeFilter()
    for stamp in (0.5, 1.0, 1.5):
        assert track.update(Relative(stamp, truth(stamp), SMALL), **made)

    def elsewhere(stamp):
        """The source 15 m beside its true place, as it would drive there."""
        beside = se3.from_xyz_rpy(x=15) @ driving(stamp, 'source')
        return se3.inverse(driving(stamp, 'target')) @ beside

    assert not track.update(Relative(2.0, elsewhere(2.0), SMALL), **made)
    assert track.contradicted == 1
    np.testing.assert_allclose(track.estimate.T_target_source[:3, 3], truth(2.0)[:3, 3], atol=0.1)
    assert track.update(Relative(2.5, truth(2.5), SMALL), **made)  # right again
    assert not track.update(Relative(3.0, elsewhere(3.0), SMALL), **made)
    assert track.update(Relative(3.5, elsewhere(3.5), SMALL), **made)
    assert track.carry(3.5, **made)
    np.testing.assert_allclose(track.estimate.T_target_source, elsewhere(3.5), atol=0.5)


def test_reset_forgets_and_missing_odometry_does_not_carry():
    made, track = odometries(1.0), RelativeFilter()
    assert not track.carry(0.5, **made)
    track.update(Relative(0.5, truth(0.5), SMALL), **made)
    assert not track.carry(3.0, **made)
    track.reset()
    assert track.estimate is None
