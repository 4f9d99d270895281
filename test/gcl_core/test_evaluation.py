import numpy as np
import pytest

from gcl_core import se3
from gcl_core.data.pairs import Pair, draw_pairs
from gcl_core.evaluation import metrics
from gcl_core.evaluation.peers import fpfh_ransac
from gcl_core.evaluation.predict import Prediction, predict
from gcl_core.evaluation.score import markdown, score


def test_errors_of_identity_and_of_a_known_offset():
    T = se3.from_xyz_rpy(3, 1, 0, yaw=0.7)
    assert metrics.rte(T, T) == 0
    assert metrics.rre_deg(T, T) == 0
    off = T @ se3.from_xyz_rpy(x=0.5, yaw=np.deg2rad(1.2))
    assert metrics.rte(off, T) == pytest.approx(0.5)
    assert metrics.rre_deg(off, T) == pytest.approx(1.2)
    assert metrics.registered(off, T, metrics.STRICT)
    assert not metrics.registered(off @ se3.from_xyz_rpy(x=0.2), T, metrics.STRICT)
    assert not metrics.registered(None, T, metrics.LOOSE)


def test_wilson_interval():
    # Example of Newcombe (1998), table I: 81 of 263.
    assert metrics.wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert metrics.wilson(0, 10)[0] == 0.0
    assert metrics.wilson(10, 10)[1] == 1.0


def prediction(T, seconds=1.0):
    return Prediction('m', 's', Pair(0, 1, 7.0, (5, 10)), 0.0, np.eye(4), T, seconds)


def test_score_counts_right_wrong_and_withheld():
    estimates = [np.eye(4), se3.from_xyz_rpy(x=1.0), se3.from_xyz_rpy(x=9.0), None]
    (row,) = score([prediction(T) for T in estimates])
    assert (row.pairs, row.strict, row.loose, row.found, row.wrong) == (4, 1, 2, 3, 1)
    assert row.rte == pytest.approx(0.5)
    assert '25 (' in markdown([row])


def test_random_yaw_turns_the_truth_along(drive):
    pairs = draw_pairs(drive, per_bin=1)[:1]
    seen = {}

    def spy(source, target):
        seen['source'] = source
        return None

    (p,) = predict({'spy': spy}, drive, pairs, random_yaw_seed=3)
    assert p.turned != 0.0
    original = drive.scan(pairs[0].source).points.astype(float)
    back = se3.transform(p.T_true, seen['source'].points.astype(float))
    T = se3.inverse(drive.T_world_lidar(pairs[0].target)) @ drive.T_world_lidar(pairs[0].source)
    np.testing.assert_allclose(back, se3.transform(T, original), atol=1e-3)


def test_peer_registers_a_close_pair(drive):
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(95)
    estimate = fpfh_ransac(drive.scan(95), drive.scan(90))
    assert metrics.registered(estimate, T, metrics.LOOSE)
