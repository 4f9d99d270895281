"""The node as a user runs it: a process of its own, real DDS, real clouds."""

import os
import random
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_ros.bag import pair_encounters, write_bag
from gcl_ros.conversions import fill_point_cloud2, matrix

ROOT = Path(__file__).parents[2]
READY = 90.0  # seconds that a loaded machine may take to start the node
FAST = ['-p', 'registrar.turns:=1']


@pytest.fixture
def environment():
    """Environment of a DDS domain of this test's own, big clouds allowed."""
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(random.randint(1, 100)),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'FASTDDS_DEFAULT_PROFILES_FILE': str(ROOT / 'config' / 'fastdds.xml'),
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
    return [sys.executable, '-m', 'gcl_ros.registrar_node', '--ros-args', *ros_arguments]


def wait_for(condition, timeout=READY):
    until = time.monotonic() + timeout
    while time.monotonic() < until:
        if condition():
            return True
        time.sleep(0.05)
    return False


class Vehicles:
    """Publishes both clouds and collects transforms."""

    def __init__(self, domain: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node('vehicles', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.sides = {
            side: self.node.create_publisher(PointCloud2, f'/{side}/points', 5)
            for side in ('source', 'target')
        }
        self.stamp = 0
        self.received: list[TransformStamped] = []
        self.node.create_subscription(
            TransformStamped, '/registrar/transform', self.received.append, 10
        )

    def stream(self, source: np.ndarray, target: np.ndarray, until) -> bool:
        """Send the pair again and again, at stamps of its own, until something happens."""
        deadline = time.monotonic() + READY
        while time.monotonic() < deadline:
            self.stamp += 1
            self.send('source', self.stamp, source)
            self.send('target', self.stamp, target)
            for _ in range(5):
                self.executor.spin_once(timeout_sec=0.1)
                if until():
                    return True
        return False

    def send(self, side: str, stamp: int, points: np.ndarray) -> None:
        message = fill_point_cloud2(PointCloud2(), points, PointField)
        message.header.stamp.sec = stamp
        message.header.frame_id = f'{side}_lidar'
        self.sides[side].publish(message)

    def spin_until_received(self, count: int, timeout: float = 60.0) -> bool:
        until = time.monotonic() + timeout
        while len(self.received) < count and time.monotonic() < until:
            self.executor.spin_once(timeout_sec=0.1)
        return len(self.received) >= count

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def vehicles(environment, monkeypatch):
    for key in ('FASTDDS_DEFAULT_PROFILES_FILE', 'ROS_AUTOMATIC_DISCOVERY_RANGE'):
        monkeypatch.setenv(key, environment[key])
    node = Vehicles(int(environment['ROS_DOMAIN_ID']))
    yield node
    node.close()


def test_publishes_the_transform_and_survives_bad_clouds(environment, vehicles, drive, tmp_path):
    log = tmp_path / 'log'
    source, target = drive.scan(98).points, drive.scan(90).points
    with running(registrar(*FAST), environment, log) as process:
        empty, nan = source[:0], np.full((100, 3), np.nan, np.float32)
        assert vehicles.stream(empty, target, lambda: 'is empty' in log.read_text())
        assert vehicles.stream(nan, target, lambda: 'points is finite' in log.read_text())
        assert not vehicles.received
        assert vehicles.stream(source, target, lambda: vehicles.received), log.read_text()
        assert process.poll() is None
    message = vehicles.received[0]
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    assert metrics.registered(matrix(message.transform), T, metrics.STRICT)
    assert (message.header.frame_id, message.child_frame_id) == ('target_lidar', 'source_lidar')
    assert 0 < message.header.stamp.sec <= vehicles.stamp


def test_replayed_bag_comes_out_right(environment, vehicles, drive, tmp_path):
    """A bag through `replay` and `registrar`, both processes of their own."""
    encounters = list(pair_encounters(drive, drive, [(96, 90), (104, 92)], period=4.0))
    write_bag(tmp_path / 'bag', encounters)
    parameters = ROOT / 'config' / 'registrar.yaml'
    with running(
        registrar('--params-file', str(parameters), *FAST), environment, tmp_path / 'log'
    ):
        replay = [sys.executable, '-m', 'gcl_ros.replay', str(tmp_path / 'bag')]
        with running(replay, environment, tmp_path / 'replay_log'):
            got_all = vehicles.spin_until_received(2, timeout=READY)
    assert got_all, (tmp_path / 'log').read_text() + (tmp_path / 'replay_log').read_text()
    for encounter, message in zip(encounters, vehicles.received, strict=True):
        assert message.header.stamp.sec == int(encounter.stamp)
        estimate = matrix(message.transform)
        assert metrics.registered(estimate, encounter.T_target_source, metrics.STRICT)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['-p', 'registrar.trun:=1'], 'unknown parameter registrar.trun'),
        (['-p', 'registrar.turns:=0'], 'turns is 0'),
        (['-p', 'registrar.turns:=many'], "expected int, got 'many'"),
        (['-p', 'registrar.weights:=other'], "no weights 'other'"),
    ],
)
def test_bad_parameters_are_logged_and_the_node_lives(environment, tmp_path, arguments, message):
    log = tmp_path / 'log'
    with running(registrar(*arguments), environment, log) as process:
        assert wait_for(lambda: message in log.read_text()), log.read_text()
        assert 'nothing will be published' in log.read_text()
        assert process.poll() is None


def test_replay_of_a_missing_bag_exits_with_two(environment, tmp_path):
    command = [sys.executable, '-m', 'gcl_ros.replay', str(tmp_path / 'none')]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=READY)
    assert done.returncode == 2
    assert 'cannot read bag' in done.stderr
