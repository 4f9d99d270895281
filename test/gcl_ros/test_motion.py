"""Odometry and registrations of two driving vehicles, the truth of which is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcl_core import se3
from gcl_ros.motion import (
    GATE,
    Drift,
    Relative,
    RelativeFilter,
    blurred,
    carried,
    difference,
    shifted,
)
from gcl_ros.odometry import STILL, Odometry

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
    arc = lambda i: se3.from_xyz_rpy(x=5 * np.sin(0.2 * i), y=5 - 5 * np.cos(0.2 * i), yaw=0.2 * i)  # noqa: E731
    for i in range(3):
        odometry.add(1.0 + 0.1 * i, arc(i))
    np.testing.assert_allclose(odometry.at(1.05), arc(0.5) @ se3.from_xyz_rpy(z=1.8), atol=1e-12)
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


def driven(rate, *, noise=0.0, way=10.0, seconds=1.0):
    """A track whose source drives while the target stands, after as many steps as odometry has."""
    made, rng = {'source': Odometry(), 'target': Odometry()}, np.random.default_rng(0)
    track = RelativeFilter(Drift(distance=0.02, turn=0.002, still=0.01))
    T = se3.from_xyz_rpy(x=20.0, yaw=np.pi)
    for step in range(rate + 1):
        shake = rng.normal(size=3) * noise
        there = se3.from_xyz_rpy(way * step / rate + shake[0], *shake[1:], yaw=0.5 * step / rate)
        made['source'].add(seconds * step / rate, there)
        made['target'].add(seconds * step / rate, np.eye(4))
        if step == 0:
            track.update(Relative(0.0, T, SMALL), **made)
        else:
            assert track.carry(seconds * step / rate, **made)
    return track, made


@pytest.mark.parametrize('rate', [2, 10, 100, 1000])
@pytest.mark.parametrize('noise', [0.0, 0.005])
def test_the_stated_deviation_is_that_of_the_way_whatever_the_rate(rate, noise):
    covariance = driven(rate, noise=noise)[0].estimate.covariance
    added = np.hypot(0.02 * 10 + 0.01, 0.01)  # the source drove, both may have slid
    lever = 10 * 0.01  # of the registration's own turn, which leads the way aside
    assert np.sqrt(covariance[0, 0]) == pytest.approx(np.hypot(0.1, added), rel=0.03)
    assert np.sqrt(covariance[2, 2]) == pytest.approx(
        np.hypot(np.hypot(0.1, lever), added), rel=0.03
    )
    assert np.sqrt(covariance[5, 5]) == pytest.approx(np.hypot(0.01, 0.02), rel=0.03)


@pytest.mark.parametrize('rate', [1, 10, 100])
def test_the_gate_does_not_ask_for_the_rate_either(rate):
    """What lies 1 m beside the way driven is within its deviation; 4 m beside it is not."""
    for beside, agrees in ((1.0, True), (4.0, False)):
        track, made = driven(rate)
        seen = shifted(track.estimate.T_target_source, np.array([0, 0, beside, 0, 0, 0]))
        assert track.update(Relative(1.0, seen, SMALL), **made) == agrees


def test_the_way_is_the_same_in_one_piece_or_in_many():
    odometry = odometries(2.0)['target']
    parts = [odometry.moved(0.1 * i, 0.1 * (i + 1)) for i in range(20)]
    whole = odometry.moved(0.0, 2.0)
    together = STILL
    for part in parts:
        together = together.then(part)
    np.testing.assert_allclose(together.T, whole.T, atol=1e-9)
    assert together.driven == pytest.approx(whole.driven)
    assert odometry.moved(2.0, 0.0).driven == pytest.approx(-whole.driven)
    length = np.hypot(10, 2 * np.cos(np.linspace(0, 2, 1001))).mean() * 2  # of the curve
    assert whole.driven == pytest.approx(length, rel=0.01)


def test_a_registration_between_two_steps_of_odometry_is_taken_in_at_its_own_time():
    """The track is the same whether a registration comes at once or 0.3 s late."""
    made, tracks = odometries(3.0), []
    for late in (0.0, 0.3):
        track = RelativeFilter()
        track.update(Relative(0.5, truth(0.5), SMALL), **made)
        track.carry(1.5 + late, **made)
        beside = shifted(truth(1.5), np.array([0.1, 0.1, 0, 0, 0, 0.01]))
        assert track.update(Relative(1.5, beside, SMALL), **made)
        assert track.carry(2.5, **made)
        tracks.append(track.estimate)
    np.testing.assert_allclose(tracks[0].T_target_source, tracks[1].T_target_source, atol=1e-9)
    np.testing.assert_allclose(tracks[0].covariance, tracks[1].covariance, atol=1e-9)


@pytest.mark.parametrize('side', ['source', 'target'])
def test_motion_that_is_left_in_a_scan_is_one_deviation_in_its_direction(side):
    """A scan that is as if seen from a bit further on shifts the registration by that."""
    T = se3.from_xyz_rpy(x=30.0, y=-4.0, yaw=2.0)
    left = np.array([0.02, 0.001, 0.0, 0.0, 0.0, 0.0015])  # small, so that it is linear
    moved = se3.from_rotation_translation(Rotation.from_rotvec(left[3:]).as_matrix(), left[:3])
    seen = T @ moved if side == 'source' else se3.inverse(moved) @ T
    error = difference(seen, T)
    motions = {'source': np.zeros(6), 'target': np.zeros(6)} | {side: left}
    grown = blurred(T, SMALL, **motions) - SMALL
    np.testing.assert_allclose(grown, np.outer(error, error), atol=1e-5)
    assert np.sqrt(error @ np.linalg.pinv(grown) @ error) == pytest.approx(1.0, abs=0.01)


def test_reset_forgets_and_missing_odometry_does_not_carry():
    made, track = odometries(1.0), RelativeFilter()
    assert not track.carry(0.5, **made)
    track.update(Relative(0.5, truth(0.5), SMALL), **made)
    assert not track.carry(3.0, **made)
    track.reset()
    assert track.estimate is None
