import numpy as np
import pytest

from gcl_core import se3
from gcl_ros.meeting import DISTANCES, encounters, format_row, summary
from gcl_ros.session import Row

TRUE = se3.from_xyz_rpy(x=30.0, yaw=np.pi)


def row(T):
    return Row(TRUE, 0.0, T, 1.5)


def test_oncoming_vehicles_meet_at_the_stated_distances():
    for meeting, distance in zip(encounters(), DISTANCES, strict=True):
        T = meeting.T_target_source
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(distance, abs=1.5)
        assert abs(se3.yaw(T)) > np.pi / 2


def test_summary_tells_right_wrong_and_withheld():
    right, wrong = row(TRUE @ se3.from_xyz_rpy(x=0.1)), row(np.eye(4))
    text, good = summary([right, wrong, row(None)])
    assert '3 pairs: 1 registered' in text
    assert '1 wrong; 1 withheld' in text
    assert not good
    assert summary([right, row(None)])[1]
    assert not summary([row(None)])[1]
    assert 'no transform published' in format_row(row(None))
    assert '0.10 m' in format_row(right)
