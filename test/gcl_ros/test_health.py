"""What the diagnostics make of frames and clocks."""

import numpy as np
import pytest

from gcl_core.types import Registration
from gcl_ros.health import HANGS, OK, WARN, Health, Limits, Outcome

LIMITS = Limits(silence=2.0, max_age=5.0, max_pair_dt=0.1)


def heard(source='b/lidar', target='a/lidar'):
    health = Health()
    health.heard('source', source, now=0.0)
    health.heard('target', target, now=0.0)
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
        health.heard('target', 'a/lidar', now=0.0, again=True)
    level, message = health.judge(0.0, LIMITS, 0.0)
    assert level == WARN
    assert message.startswith('target/points sends one cloud again and again')
    health.heard('target', 'a/lidar', now=0.0)
    assert health.judge(0.0, LIMITS, 0.0)[0] == OK


@pytest.mark.parametrize(
    ('age', 'level', 'message'),
    [
        (0.3, OK, 'registering'),
        (7.0, WARN, 'transform 7.00 s old, 5 wanted'),
        (1.7e9, WARN, 'stamps 1700000000 s behind the clock of the node: is use_sim_time'),
        (-1.7e9, WARN, 'stamps -1700000000 s behind the clock of the node: is use_sim_time'),
    ],
)
def test_late_transforms_and_stamps_of_another_clock(age, level, message):
    health = heard()
    result = Registration(np.eye(4), 100, 200, '', {}, accepted=True)
    health.done(Outcome(result, age, dt=0.0, headings=1))
    found = health.judge(0.0, LIMITS, 0.0)
    assert found[0] == level
    assert found[1].startswith(message)
