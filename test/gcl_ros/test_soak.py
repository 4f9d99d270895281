"""The fault run's own parts: its schedule, its judgement, and a recording without room."""

import subprocess
import sys
import threading
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from gcl_core.types import PointCloud
from gcl_ros.bag import Encounter, write_bag
from gcl_ros.soak.__main__ import DOMAIN, failures, soak
from gcl_ros.soak.faults import Fault, Kind, active, schedule
from gcl_ros.soak.machine import Machine
from gcl_ros.soak.publisher import PERIOD, SCENE, Vehicle
from gcl_ros.soak.watch import FLAT, in_short, memory_change
from gcl_ros.transport import PROFILE, read_here

ROOT = Path(__file__).parents[2]
ALONE = {  # what a run sets for its processes
    'ROS_DOMAIN_ID': DOMAIN,
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    read_here()[0]: str(PROFILE),
}


@pytest.fixture
def bag(tmp_path):
    points = np.random.default_rng(0).normal(0, 10, (30_000, 3)).astype(np.float32)
    cloud = PointCloud(points)
    write_bag(tmp_path / 'scenes', [Encounter(1.0 + i, cloud, cloud, np.eye(4)) for i in range(2)])
    return tmp_path / 'scenes'


def test_the_schedule_follows_from_the_seed_and_holds_every_kind():
    faults = schedule(3, 3 * 60)
    assert faults == schedule(3, 3 * 60) != schedule(4, 3 * 60)
    assert len(schedule(3, 3600)) > 200
    assert {fault.kind for fault in schedule(3, 200)} == set(get_args(Kind))
    assert all(a.end < b.start for a, b in pairwise(faults))
    first = faults[0]
    assert active(faults, first.start) == active(faults, first.end - 0.1) == first
    assert active(faults, first.start - 0.1) is None is active(faults, first.end)


def test_a_vehicle_does_what_the_schedule_says(bag):
    faults = {fault.kind: fault for fault in schedule(0, 200)}
    source = Vehicle('source', bag, seed=0)

    def sent(kind):
        return [source.sends(tick, faults.get(kind)) for tick in range(100)]

    assert [[(d, s) for d, _, s in m] for m in sent('none')] == [
        [(0.0, tick * PERIOD)] for tick in range(100)
    ]
    assert 20 < sum(not messages for messages in sent('drop')) < 80
    assert 0.5 < max(messages[0][0] for messages in sent('delay')) < 1.0
    assert {len(messages) for messages in sent('repeat')} == {1, 2, 3}
    arrival = [0.1 * tick + messages[0][0] for tick, messages in enumerate(sent('reorder'))]
    assert arrival != sorted(arrival)
    assert all(m[0][2] >= 0.1 * tick + 2.0 for tick, m in enumerate(sent('step apart')))
    assert all(m[0][2] <= 0.1 * tick - 5.0 for tick, m in enumerate(sent('step back')))
    assert {len(messages) for messages in sent('garbage')} == {2}
    frames = {m[0][1].header.frame_id for m in sent('none')[: 2 * SCENE]}
    assert frames == {'source/lidar_00', 'source/lidar_01'}


def test_a_recording_without_room_is_refused_and_leaves_nothing(bag, tmp_path):
    command = [sys.executable, '-m', 'gcl_ros.soak.recording', str(bag), str(tmp_path / 'out')]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('cannot write ') == 2
    assert list((tmp_path / 'out').iterdir()) == []


def test_every_recording_without_room_is_judged_and_a_run_may_end_within_one(bag, tmp_path):
    machine = Machine(bag, tmp_path, seed=0, seconds=1.0)
    for start in (0.0, 1.0):
        machine.bring(Fault('full disk', start, start + 1.0, 0.5))
    assert machine.stop() is not None
    assert machine.brought == {'full disk': 2}
    assert machine.recordings_failed() == ''
    machine._recordings.append(subprocess.Popen([sys.executable, '-c', 'exit("kept")']))
    assert machine.recordings_failed().startswith('1 of 3')


def test_a_run_that_is_interrupted_reports_what_it_saw(bag, tmp_path, monkeypatch):
    for name, value in ALONE.items():
        monkeypatch.setenv(name, value)
    stop = threading.Event()
    stop.set()
    report = soak(tmp_path, 60.0, 0, stop)
    assert report['failures'][0] == 'the run ended after 0.0 s: it was interrupted'
    assert (report['accepted'], report['wrong'], report['faults']) == (0, 0, {})
    assert {'reasons', 'memory_mb', 'cpu', 'date'} <= set(report)


def test_memory_that_grows_after_the_node_is_warm_is_told():
    warming = [500.0 + 10 * k for k in range(50)]
    assert abs(memory_change([*warming, *[1000.0] * 50])) < FLAT
    assert memory_change([*warming, *[1000.0 + 5 * k for k in range(50)]]) > FLAT


def test_memory_is_told_in_short():
    told = in_short([400.0, 500.0, 520.0, 510.0])
    assert told == {'start': 400.0, 'warm': 520.0, 'end': 510.0, 'peak': 520.0}
    assert in_short([]) == {}


GOOD = {
    'seconds': 60.0,
    'problem': '',
    'node exit': 0,
    'answers': 10,
    'unanswered': 0,
    'not active': 0,
    'accepted': 5,
    'wrong': 0,
    'unexplained': [],
    'recording': '',
    'memory_change': 0.01,
}


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        ({'seconds': 30.0, 'node exit': -11}, 'the node ended after 30'),
        ({'seconds': 30.0, 'problem': 'no room'}, 'the run ended after 30.0 s: no room'),
        ({'unanswered': 1}, 'did not answer'),
        ({'answers': 0}, 'did not answer'),
        ({'wrong': 1}, '1 of 5 transforms were wrong'),
        ({'accepted': 0}, 'no transform'),
        ({'unexplained': ['left out: OK']}, '1 refusals without a reason'),
        ({'recording': 'left behind'}, 'full disk: left behind'),
        ({'memory_change': -0.2}, 'memory changed by -20'),
    ],
)
def test_whatever_is_not_as_it_must_be_fails_the_run(change, text):
    assert failures(GOOD, 60.0) == []
    assert text in failures(GOOD | change, 60.0)[0]
