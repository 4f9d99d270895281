"""The emulated link, where the machine lets one be made; else it must say what it needs."""

import math
import os
import random
import shutil
import subprocess

import pytest

from gcl_core.errors import GclError
from gcl_ros.bench_link import measure, rows, slow_link, table

MIGHT = os.geteuid() == 0 and bool(shutil.which('ip')) and bool(shutil.which('tc'))


def namespaces() -> str:
    return subprocess.run(['ip', 'netns', 'list'], capture_output=True, text=True).stdout


def test_small_clouds_come_soon_and_large_ones_late(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(random.randint(1, 100)))
    if not MIGHT:
        with pytest.raises(GclError, match='needs root'):
            measure(tmp_path, mbit=27.0, number=2)
        return
    found = {row.name: row for row in measure(tmp_path, mbit=27.0, number=2)}
    assert found['1000 key points'].bytes == 40_000
    assert found['raw'].bytes == 1_920_000
    assert found['raw'].median_ms > 1.92e6 * 8 / 27e6 * 1e3  # what the rate alone takes
    assert found['1000 key points'].median_ms < found['raw'].median_ms / 5
    assert 'gcl_' not in namespaces()


def test_namespaces_go_when_something_fails():
    if not MIGHT:
        with pytest.raises(GclError, match='iproute2'), slow_link(27.0):
            pass
        return
    made = []

    def fail() -> None:
        with slow_link(27.0) as names:
            made.extend(name for name in names if name in namespaces())
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert len(made) == 2
    assert 'gcl_' not in namespaces()


def test_what_did_not_come_is_said():
    found = rows({'raw': [0.5, 0.7]}, {'raw': [0.4, 0.4, 0.4], '250 key points': [0.001]})
    assert [row.received for row in found] == ['2/3', '0/1']
    assert (found[0].median_ms, found[0].blocked_ms) == (600.0, 400.0)
    assert math.isnan(found[1].median_ms)
    assert '| 250 key points | 10,000 | 0/1 | nan |' in table(found)
