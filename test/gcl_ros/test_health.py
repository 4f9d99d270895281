"""What the diagnostics make of frames and clocks."""

import numpy as np
import pytest

from gcl_core.types import Registration
from gcl_ros.health import OK, WARN, Health, Outcome
from gcl_ros.pairing import Counts
from gcl_ros.streams import HANGS, Limits

CLOCK = 1.7e9
LIMITS = Limits(silence=2.0, max_age=5.0, max_pair_dt=0.1)


def heard(source='b/lidar', target='a/lidar', behind=0.1):
    """Both topics, a cloud each that came so many seconds after its stamp."""
    health = Health()
    health.heard('source', source, CLOCK - behind, now=0.0, clock=CLOCK)
    health.heard('target', target, CLOCK - behind, now=0.0, clock=CLOCK)
    return health


def test_two_vehicles_in_one_frame_are_a_warning():
    level, message = heard('velodyne', 'velodyne').judge(0.0, LIMITS, 0.0)
    assert level == WARN
    assert "both clouds are in frame 'velodyne'" in message
    assert heard().judge(0.0, LIMITS, 0.0)[0] == OK


def test_a_topic_that_repeats_one_cloud_is_a_warning():
    health = heard()
    for number in range(HANGS):
        assert health.judge(0.0, LIMITS, 0.0)[0] == OK, number
        health.heard('target', 'a/lidar', CLOCK, now=0.0, clock=CLOCK, again=True)
    level, message = health.judge(0.0, LIMITS, 0.0)
    assert level == WARN
    assert message.startswith('target/points sends one cloud again and again')
    health.heard('target', 'a/lidar', CLOCK, now=0.0, clock=CLOCK)
    assert health.judge(0.0, LIMITS, 0.0)[0] == OK


@pytest.mark.parametrize(
    ('behind', 'age', 'level', 'message'),
    [
        (0.1, 0.3, OK, 'registering'),
        (0.1, 7.0, WARN, 'transform 7.00 s old, 5 wanted'),
        (3.0, 7.0, WARN, 'transform 7.00 s old, 5 wanted, 3.00 of it before its clouds came'),
        (7.0, 7.3, WARN, 'source/points has stamps 7.0 s behind the clock of the node: '),
        (-0.3, 0.1, OK, 'registering'),
    ],
)
def test_a_slow_node_and_stamps_of_another_clock_are_told_apart(behind, age, level, message):
    health = heard(behind=behind)
    result = Registration(np.eye(4), 100, 200, '', {}, accepted=True)
    health.done(Outcome(result, age, dt=0.0))
    found = health.judge(0.0, LIMITS, 0.0)
    assert found[0] == level
    assert found[1] == message or (message.endswith(': ') and found[1].startswith(message))
    assert ('old' in found[1]) == ('old' in message)


def test_a_probability_of_other_weights_is_a_warning_and_a_figure():
    health = heard()
    for calibrated in (True, False):
        result = Registration(np.eye(4), 100, 200, accepted=True, calibrated=calibrated)
        health.done(Outcome(result, 0.3, dt=0.0))
        level, message = health.judge(0.0, LIMITS, 0.0)
        assert (level, 'uncalibrated' in message) == ((OK, False) if calibrated else (WARN, True))
        assert health.figures(0.0, Counts())['calibrated'] == str(calibrated)
