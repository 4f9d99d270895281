"""The bench of ages: what it makes of what it saw, and once over real DDS."""

import os
import random
import subprocess
import sys

import numpy as np
import pytest

from gcl_core import se3
from gcl_ros import bench_age
from gcl_ros.bench_age import COUNTS, Record, summary
from gcl_ros.bench_stream import messages, there_and_back
from gcl_ros.compact_cloud import compact_cloud
from gcl_ros.conversions import point_cloud
from gcl_ros.usage import growth, usage

MB = 1_000_000


def test_a_meeting_goes_there_and_back():
    assert [there_and_back(number, 3) for number in range(6)] == [0, 1, 2, 1, 0, 1]


def test_growth_is_a_slope_after_the_warm_up():
    times = list(range(10))
    values = [0, 50, 90] + [100 + 2 * t for t in range(7)]
    assert growth(times, values, warm_up=3) == pytest.approx(2.0)
    assert growth(times, values, warm_up=8) is None


def test_usage_sees_memory_and_work():
    """Of a process that holds 80 MB and works for 0.3 s."""
    work = 'import time; a = bytearray(80 * 10**6); b = time.process_time()\n'
    work += 'while time.process_time() < b + 0.3: pass\nprint(1, flush=True); input()'
    command = [sys.executable, '-S', '-c', work]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        seen = usage(process.pid)
        process.communicate(b'\n')
    assert 80 * MB < seen.resident < 200 * MB
    assert 0.3 <= seen.cpu < 10.0


def recorded(estimated) -> Record:
    figures = {key: '3' for key in COUNTS} | {'accepted': '2', 'withheld': '1', 'total ms': '90'}
    return Record(
        stamps=[100.0, 100.1, 100.2],
        ages=[0.2, 0.3, 0.4],
        estimated=estimated,
        headings=[6, 1, 1, 1],
        waiting=[2, 3, 2, 0],
        watched=[(100.0, 5.0, 400 * MB), (101.0, 5.5, 401 * MB), (104.0, 8.0, 401 * MB)],
        figures=figures,
    )


def test_the_summary_counts_what_is_wrong():
    truth = np.stack([se3.from_xyz_rpy(x=10.0 - k) for k in range(2)])
    right = [truth[0], truth[1], truth[0]]
    found = summary(recorded(right), truth, begin=100.0, rate=10.0)
    assert found['wrong'] == 0
    assert found['age_s']['median'] == 0.3
    assert found['cpu_s_per_pair'] == 1.0
    assert found['cpu_percent'] == 75.0
    assert found['searched_at_one_heading'] == 0.75
    assert found['most_clouds_waiting'] == 3
    assert found['resident_mb']['largest'] == 401.0
    wrong = [truth[0], truth[1] @ se3.from_xyz_rpy(yaw=0.2), truth[0]]
    assert summary(recorded(wrong), truth, begin=100.0, rate=10.0)['wrong'] == 1


def test_the_meeting_is_as_large_as_a_real_one(streams):
    truth = np.load(streams / 'truth.npy')
    apart = np.linalg.norm(truth[:, :3, 3], axis=1)
    assert (apart[0], apart[-1]) == (pytest.approx(44, abs=2), pytest.approx(9, abs=2))
    for side in ('source', 'target'):
        clouds = messages(streams, side)
        assert len(clouds) == len(truth)
        assert all(110_000 < len(point_cloud(cloud)) < 130_000 for cloud in clouds)
        assert len(clouds[0].data) == 16 * clouds[0].width


def test_the_source_may_send_compact_scans(streams):
    whole, sent = messages(streams, 'source'), messages(streams, 'source', compact=True)
    assert len(sent) == len(whole)
    assert sent[0].header == whole[0].header
    assert len(sent[0].data) < 0.01 * len(whole[0].data)
    assert 1000 < len(compact_cloud(sent[0])) < len(point_cloud(whole[0]))


def test_it_runs(streams, monkeypatch):
    """Two streams into a registrar, each a process; ages are for a quiet machine to tell."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(random.randint(1, 100)))
    monkeypatch.setattr(bench_age, 'IDLE', 1.0)
    found = bench_age.measure(streams, minutes=0.05, rate=2.0, offset=0.02, settings=[])
    assert found['transforms'] > 0
    assert found['wrong'] == 0
    assert found['left out'] == 0
    assert found['most_clouds_waiting'] <= 20
    assert found['resident_mb']['first'] > 100
    for name in ('registrar', 'source', 'target'):
        assert 'Traceback' not in (streams / f'{name}.log').read_text()
    assert os.path.getsize(streams / 'registrar.log') > 0
