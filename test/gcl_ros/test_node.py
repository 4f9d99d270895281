"""The programs as a user runs them: processes of their own, real DDS, signals."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from geometry_msgs.msg import TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_ros.bag import pair_encounters, write_bag
from gcl_ros.registrar_node import RegistrarNode
from gcl_ros.session import through_node
from gcl_ros.transport import PROFILE, read_here

ROOT = Path(__file__).parents[2]
READY = 60.0  # seconds that a loaded machine may take to start the node


@pytest.fixture
def environment():
    """Environment of a DDS domain of this test's own, big clouds allowed."""
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(random.randint(1, 100)),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        read_here()[0]: str(PROFILE),
        'PYTHONPATH': str(ROOT),
        'PYTHONUNBUFFERED': '1',
    }


@contextmanager
def running(command, environment, log):
    """Run a process; its output goes to the file `log`."""
    with log.open('w') as out:
        process = subprocess.Popen(command, env=environment, stdout=out, stderr=out)
        try:
            yield process
        finally:
            process.terminate()
            process.wait(timeout=30)


def registrar(*ros_arguments):
    return [sys.executable, '-m', 'gcl_ros.registrar', '--ros-args', *ros_arguments]


def wait_for(condition):
    until = time.monotonic() + READY
    while time.monotonic() < until:
        if condition():
            return True
        time.sleep(0.05)
    return False


def test_replayed_bag_comes_out_right(drive, tmp_path, monkeypatch):
    """A bag through `replay` and `registrar`, both processes of their own."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(random.randint(1, 100)))
    encounters = list(pair_encounters(drive, drive, [(96, 90), (104, 92)], period=4.0))
    write_bag(tmp_path / 'bag', encounters)
    parameters = str(ROOT / 'config' / 'registrar.yaml')
    rows = through_node(
        tmp_path / 'bag',
        tmp_path,
        expected=2,
        node_arguments=['--params-file', parameters, '-p', 'registrar.headings:=1'],
    )
    logs = [(tmp_path / f'{name}.log').read_text() for name in ('registrar', 'replay')]
    assert len(rows) == 2, logs
    for row in rows:
        assert metrics.registered(row.T_estimated, row.T_true, metrics.STRICT), logs


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['-p', 'registrar.heding:=1'], 'registrar.heding (did you mean registrar.headings'),
        (['-p', 'headings:=1'], 'unknown parameter headings (did you mean registrar.headings'),
        (['-p', 'registrar.headings:=0'], 'headings is 0'),
        (['-p', 'registrar.headings:=many'], "expected int, got 'many'"),
        (['-p', 'registrar.weights:=other'], "no weights 'other'"),
    ],
)
def test_bad_parameters_are_logged_and_the_node_lives(environment, tmp_path, arguments, message):
    log = tmp_path / 'log'
    with running(registrar(*arguments), environment, log) as process:
        assert wait_for(lambda: message in log.read_text()), log.read_text()
        assert 'nothing will be published' in log.read_text()
        assert process.poll() is None


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (None, 'Error opening YAML file'),
        ('registrar:\n  ros__parameters:\n    sources: [a, 1]\n', 'should be of same type'),
    ],
)
def test_a_file_of_parameters_that_is_none_ends_it_with_two(environment, tmp_path, text, message):
    path = tmp_path / 'parameters.yaml'
    if text is not None:
        path.write_text(text)
    command = registrar('--params-file', str(path))
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=READY)
    assert done.returncode == 2, done.stderr
    assert (str(path) in done.stderr, message in done.stderr) == (True, True), done.stderr
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize(
    ('setting', 'message'),
    [
        ('registrar.heding:=1', 'unknown parameter registrar.heding'),
        ('registrar.headings:=[1', 'it ended, exit code 2'),
    ],
)
def test_a_bag_is_not_played_to_a_node_that_cannot_work(
    drive, tmp_path, monkeypatch, setting, message
):
    """The bag lasts ten minutes; nobody waits for its end."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(random.randint(1, 100)))
    write_bag(tmp_path / 'bag', list(pair_encounters(drive, drive, [(96, 90)] * 2, period=600.0)))
    with pytest.raises(GclError, match=re.escape(message)):
        through_node(tmp_path / 'bag', tmp_path, expected=2, node_arguments=['-p', setting])


INT, TERM = signal.SIGINT, signal.SIGTERM
UNSTARTED = ['-p', 'autostart:=false']


@pytest.mark.parametrize(
    ('module', 'number', 'arguments', 'said'),
    [
        ('registrar', INT, [], 'ready'),
        ('sender', TERM, [], 'ready'),
        ('registrar', TERM, UNSTARTED, 'unconfigured'),
        ('registrar', INT, ['-p', 'registrar.headings:=0'], 'will be published'),
    ],
    ids=['active', 'sender', 'unconfigured', 'misconfigured'],
)
def test_signals_end_it_cleanly_in_every_state(
    environment, tmp_path, module, number, arguments, said
):
    log = tmp_path / 'log'
    command = [sys.executable, '-m', f'gcl_ros.{module}', '--ros-args', *arguments]
    with running(command, environment, log) as process:
        assert wait_for(lambda: said in log.read_text()), log.read_text()
        process.send_signal(number)
        code = process.wait(timeout=READY)
    text = log.read_text()
    assert (code, 'Traceback' in text) == (0, False), text


@pytest.mark.parametrize(
    ('number', 'transitions'),
    [
        (INT, [Transition.TRANSITION_CONFIGURE]),
        (TERM, [Transition.TRANSITION_UNCONFIGURED_SHUTDOWN]),
    ],
    ids=['inactive', 'finalized'],
)
def test_signals_end_it_cleanly_after_transitions(rig, environment, tmp_path, number, transitions):
    log, own = tmp_path / 'log', {'ROS_DOMAIN_ID': str(rig.domain)}
    with running(registrar(*UNSTARTED), environment | own, log) as process:
        for transition in transitions:
            request = ChangeState.Request()
            request.transition.id = transition
            rig.call(ChangeState, '/registrar/change_state', request)
        state = rig.call(GetState, '/registrar/get_state').current_state.label
        assert state == ('inactive' if number == INT else 'finalized')
        process.send_signal(number)
        assert process.wait(timeout=READY) == 0
    assert 'Traceback' not in log.read_text()


@pytest.mark.parametrize('number', [INT, TERM])
def test_signals_end_it_cleanly_at_work(rig, meeting, environment, tmp_path, number):
    log, own = tmp_path / 'log', {'ROS_DOMAIN_ID': str(rig.domain)}
    rig.publish_clouds()
    with running(registrar(), environment | own, log) as process:
        send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
        assert rig.until(lambda: 'inliers' in log.read_text(), every=send, pause=0.3)
        send()
        time.sleep(0.1)  # the pair is at work now
        process.send_signal(number)
        assert process.wait(timeout=READY) == 0
    assert 'Traceback' not in log.read_text()


def test_drivers_are_killed_and_come_back(rig, streams, environment, tmp_path):
    """SIGKILL: nobody says goodbye to the node."""
    rig.add(RegistrarNode, silence=1.5)
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    environment = environment | {'ROS_DOMAIN_ID': str(rig.domain)}

    def driver(side):
        command = [sys.executable, '-m', 'gcl_ros.bench_stream', side, str(streams)]
        command += ['--begin', '1000', '--rate', '2']
        return running(command, environment, tmp_path / side)

    def alone():
        return rig.says('source/points silent') and not rig.says('target/points silent')

    with driver('target'):
        for _ in range(2):
            transforms.clear()
            with driver('source') as source:
                assert rig.until(lambda: transforms), rig.status
                source.kill()
            assert rig.until(alone), rig.status


def test_replay_of_a_missing_bag_exits_with_two(environment, tmp_path):
    command = [sys.executable, '-m', 'gcl_ros.replay', str(tmp_path / 'none')]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=READY)
    assert done.returncode == 2
    assert 'cannot read bag' in done.stderr
