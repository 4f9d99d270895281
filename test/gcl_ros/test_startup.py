"""ROS starts and ends on every distribution, wherever the program runs."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TWICE = """
import signal
from rclpy.node import Node
from gcl_ros.startup import running_ros

for own_handlers in (False, True):
    with running_ros(own_handlers=own_handlers):
        ours = signal.getsignal(signal.SIGINT)
        node = Node('once_more')
        assert node.context.ok()
    assert not node.context.ok()
"""
ONCE = """
from rclpy.node import Node
from gcl_ros.startup import running_ros

with running_ros():
    Node('once').get_logger().info('it logs')
"""
ENDED = """
import os, signal, time
from gcl_ros.startup import running_ros

with running_ros():
    pass
os.kill(os.getpid(), signal.SIGTERM)
time.sleep(60)
"""


def python(code, **environment):
    """Run code in a process; an environment variable of None is unset."""
    given = {**os.environ, 'PYTHONPATH': str(ROOT), **environment}
    given = {key: value for key, value in given.items() if value is not None}
    command = [sys.executable, '-c', code]
    return subprocess.run(command, env=given, capture_output=True, text=True, timeout=60)


def test_it_can_be_started_again_in_one_process():
    done = python(TWICE)
    assert done.returncode == 0, done.stderr


def test_signals_are_as_before_once_it_has_ended():
    assert python(ENDED).returncode == -signal.SIGTERM


@pytest.mark.parametrize(
    ('unwritable', 'reason'),
    [
        ({'HOME': None}, 'HOME is not set'),
        ({'HOME': '/dev/null'}, '/dev/null/.ros/log'),
        ({'ROS_HOME': '/dev/null/ros'}, '/dev/null/ros/log'),
        ({'ROS_LOG_DIR': '/dev/null/log'}, '/dev/null/log'),
    ],
    ids=str,
)
def test_where_no_log_can_be_written_it_goes_elsewhere(tmp_path, unwritable, reason):
    nowhere = {
        'HOME': str(tmp_path),
        'ROS_HOME': None,
        'ROS_LOG_DIR': None,
        'TMPDIR': str(tmp_path),
    }
    for _ in range(2):
        done = python(ONCE, **nowhere | unwritable)
        assert done.returncode == 0, done.stderr
        assert reason in done.stderr
        assert 'it logs' in done.stderr
    (folder,) = tmp_path.iterdir()  # one, however often it starts
    assert f'it goes to {folder}' in done.stderr
    assert any('it logs' in log.read_text() for log in folder.glob('*.log'))


def test_the_log_stays_where_it_can_be_written(tmp_path):
    done = python(ONCE, HOME=str(tmp_path), ROS_HOME=None, ROS_LOG_DIR=None)
    assert (done.returncode, 'cannot' in done.stderr) == (0, False), done.stderr
    assert list(tmp_path.glob('.ros/log/*.log'))


def test_a_machine_without_any_room_for_a_log_is_told_what_to_do(tmp_path):
    (tmp_path / f'ros_log_{os.getuid()}').write_text('in the way')
    code = f'try:\n{ONCE.replace(chr(10), chr(10) + "    ")}\nexcept ValueError as e: print(e)'
    done = python(code, HOME=None, ROS_HOME=None, ROS_LOG_DIR=None, TMPDIR=str(tmp_path))
    assert 'set ROS_LOG_DIR to a folder that can be written' in done.stdout, done.stderr
