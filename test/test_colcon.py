"""`colcon build` of the checkout, then `registrar` found and run the way `ros2 run` does."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcl_core.ops.native import build

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A colcon workspace with this package, built."""
    if not (BIN / 'colcon').exists():
        pytest.skip('colcon is not installed; `make install` brings it')
    folder = tmp_path_factory.mktemp('workspace')
    source = folder / 'src' / 'gcl_ros'
    ignored = shutil.ignore_patterns('.*', 'build', 'install', 'log', 'runs', '*.egg-info', 'test')
    shutil.copytree(ROOT, source, ignore=ignored)
    environment = {**os.environ, 'PATH': f'{BIN}:{os.environ["PATH"]}', 'AMENT_PREFIX_PATH': ''}
    subprocess.run(
        ['colcon', 'build'], cwd=folder, env=environment, check=True, capture_output=True
    )
    return folder


def test_the_ament_hook_is_made(workspace):
    """An invalid package.xml makes colcon build a plain Python package without it."""
    hooks = workspace / 'install' / 'gcl_ros' / 'share' / 'gcl_ros' / 'hook'
    assert list(hooks.glob('ament_prefix_path*'))


def test_registrar_runs_from_the_ament_index(workspace, tmp_path):
    prefix = workspace / 'install' / 'gcl_ros'
    site = next((prefix / 'lib').glob('python*')) / 'site-packages'
    environment = {**os.environ, 'AMENT_PREFIX_PATH': str(prefix), 'PYTHONPATH': str(site)}
    environment |= {'ROS_DOMAIN_ID': '101', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    find = 'import ament_index_python as a; print(a.get_package_prefix("gcl_ros"))'
    found = subprocess.run(
        [sys.executable, '-c', find], env=environment, check=True, capture_output=True, text=True
    )
    executable = Path(found.stdout.strip()) / 'lib' / 'gcl_ros' / 'registrar'
    log = tmp_path / 'log'
    with log.open('w') as out:
        process = subprocess.Popen([executable], env=environment, stdout=out, stderr=out)
    try:
        until = time.monotonic() + 90
        while 'ready' not in log.read_text() and time.monotonic() < until:
            time.sleep(0.2)
        assert 'ready; weights gcl_conv' in log.read_text()
        assert process.poll() is None
    finally:
        process.terminate()
        process.wait(timeout=30)
    for name in (*build.SOURCES, *build.HEADERS):
        assert (site / 'gcl_core/ops/native' / name).exists()
    share = prefix / 'share' / 'gcl_ros'
    for file in ('config/registrar.yaml', 'launch/replay.launch.py', 'rviz/registrar.rviz'):
        assert (share / file).exists()
    find = 'from gcl_ros.transport import PROFILE; print(PROFILE)'
    profile = subprocess.run(
        [sys.executable, '-c', find],
        cwd=tmp_path,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    assert Path(profile.stdout.strip()) == share / 'config/fastdds.xml'
    for program in ('registrar', 'sender', 'describer', 'replay', 'evaluate_bag', 'gcl'):
        command = [prefix / 'lib' / 'gcl_ros' / program, '--help']
        helped = subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True
        )
        assert (helped.returncode, f'usage: {program}' in helped.stdout) == (0, True), (
            helped.stderr
        )
