"""The programs' command lines, and Ctrl-C before they have begun to work."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcl_ros.program import own_arguments

ROOT = Path(__file__).parents[2]
PROGRAMS = {
    'registrar': ['gcl_ros.registrar'],
    'sender': ['gcl_ros.sender'],
    'describer': ['gcl_ros.describer'],
    'replay': ['gcl_ros.replay', 'bag'],
    'evaluate_bag': ['gcl_ros.evaluate_bag', 'bag', '--out', 'out'],
    'gcl register': ['gcl_core.cli.main', 'register', 'a.pcd', 'b.pcd'],
    'gcl simulate': ['gcl_core.cli.main', 'simulate', '7', 'out'],
    'demo': ['gcl_ros.demo', '--out', 'out'],
}


def environment():
    return {**os.environ, 'PYTHONPATH': str(ROOT), 'ROS_DOMAIN_ID': '102'}


def loaded(process, library) -> bool:
    """Wait until a process has opened a library; false where it has ended before."""
    maps = Path(f'/proc/{process.pid}/maps')
    while process.poll() is None:
        if library in maps.read_text():
            return True
        time.sleep(0.001)
    return False


@pytest.mark.parametrize('library', ['_multiarray_umath', 'libtorch_cpu'])
@pytest.mark.parametrize('name', PROGRAMS)
def test_ctrl_c_while_libraries_load_ends_it_without_a_traceback(tmp_path, name, library):
    """As soon as numpy is there, and torch, which takes the longest."""
    command = [sys.executable, '-m', *PROGRAMS[name]]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as process:
        if not loaded(process, library):
            pytest.fail(f'{name} ended: {process.stdout.read().decode()}')
        process.send_signal(signal.SIGINT)
        said = process.stdout.read().decode()
    assert process.returncode in (-signal.SIGINT, 130), said
    assert said == ''


@pytest.mark.parametrize('name', ['registrar', 'sender', 'describer'])
@pytest.mark.parametrize(
    ('arguments', 'code', 'says'),
    [
        (['--help'], 0, 'usage: {}'),
        (['-h', '--ros-args', '-p', 'autostart:=false'], 0, 'usage: {}'),
        (['-p', 'max_points:=5'], 2, 'unrecognized arguments: -p max_points:=5'),
        (['--ros-args', '-p', 'max_points'], 2, '{}: '),
        (['--ros-args', '--params-file', 'none.yaml'], 2, 'none.yaml'),
    ],
    ids=lambda part: ' '.join(part) if isinstance(part, list) else '',
)
def test_a_command_line_is_explained_or_refused(tmp_path, name, arguments, code, says):
    done = subprocess.run(
        [sys.executable, '-m', *PROGRAMS[name], *arguments],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, 'Traceback' in done.stderr) == (code, False), done.stderr
    assert says.format(name) in (done.stderr if code else done.stdout)


@pytest.mark.parametrize(
    ('arguments', 'own'),
    [
        ('bag --rate 2', 'bag --rate 2'),
        ('bag --ros-args -p a:=1', 'bag'),
        ('--ros-args -p a:=1 -- bag --ros-args -r b:=c', 'bag'),
        ('', ''),
    ],
)
def test_arguments_of_ros_are_told_apart(arguments, own):
    assert own_arguments(arguments.split()) == own.split()
