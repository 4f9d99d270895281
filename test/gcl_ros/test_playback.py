"""Replay over real DDS: order, rate, start, loop, clock, reliability."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.rosbag2 import StoragePlugin, Writer
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from gcl_core.errors import GclError
from gcl_core.types import PointCloud
from gcl_ros.bag import VERSION, Encounter, write_bag
from gcl_ros.bag_reader import message_types
from gcl_ros.conversions import seconds
from gcl_ros.playback import Playback, replay


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Four encounters, a second apart."""
    rng = np.random.default_rng(0)
    clouds = [PointCloud(rng.normal(size=(50, 3)).astype(np.float32)) for _ in range(2)]
    path = tmp_path_factory.mktemp('bags') / 'bag'
    write_bag(path, [Encounter(float(i), *clouds, np.eye(4)) for i in range(1, 5)])
    return path


class Player:
    def __init__(self, rig, bag, playback, node=None):
        self.node, self.count = node or rig.node, None
        best_effort = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.clouds: list = []
        for side in ('source', 'target'):
            rig.node.create_subscription(
                PointCloud2, f'/{side}/points', self.clouds.append, best_effort
            )
        self.clock = rig.listen(Clock, '/clock')
        self.truth = rig.listen(TransformStamped, '/truth/transform')
        self.thread = threading.Thread(target=self.play, args=(bag, playback), daemon=True)
        self.thread.start()

    def play(self, bag, playback):
        self.count = replay(bag, playback, self.node)

    def stamps(self):
        return [seconds(m.header.stamp) for m in self.clouds]


@pytest.mark.parametrize('reliable', [True, False])
def test_all_messages_in_order_with_the_clock(rig, bag, reliable):
    player = Player(rig, bag, Playback(rate=10.0, reliable=reliable))
    player.thread.join(timeout=60)
    assert player.count == 12
    assert rig.until(lambda: len(player.clouds) == 8)
    assert player.stamps() == [1, 1, 2, 2, 3, 3, 4, 4]
    assert rig.until(lambda: len(player.truth) == 4)
    assert sorted({seconds(m.clock) for m in player.clock}) == [1, 2, 3, 4]


SUBSCRIBER = """
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2

rclpy.init()
node = rclpy.create_node('subscriber')
taken = lambda message: print(message.header.stamp.sec, flush=True)
node.create_subscription(PointCloud2, '/source/points', taken, qos_profile_sensor_data)
rclpy.spin(node)
"""


def test_a_subscriber_that_is_busy_at_the_end_gets_the_last_cloud(rig, tmp_path):
    cloud = PointCloud(np.ones((120000, 3), np.float32))  # too big for a socket's buffer
    write_bag(
        tmp_path / 'bag', [Encounter(stamp, cloud, cloud, np.eye(4)) for stamp in (3.0, 5.0)]
    )
    environment = os.environ | {'ROS_DOMAIN_ID': str(rig.domain)}
    taken = tmp_path / 'taken'
    heard = [rig.listen(PointCloud2, f'/{side}/points') for side in ('source', 'target')]
    replayed = [sys.executable, '-m', 'gcl_ros.replay', str(tmp_path / 'bag')]
    with taken.open('w') as file:
        command = [sys.executable, '-c', SUBSCRIBER]
        subscriber = subprocess.Popen(command, stdout=file, env=environment)
    try:
        assert rig.until(lambda: rig.node.count_subscribers('/source/points') == 2)
        player = subprocess.Popen(replayed, env=environment)
        assert rig.until(lambda: taken.read_text() == '3\n')
        time.sleep(1.6)  # of two seconds
        subscriber.send_signal(signal.SIGSTOP)  # as one whose cores are taken
        assert rig.until(lambda: [len(clouds) for clouds in heard] == [2, 2])
        time.sleep(0.4)
        subscriber.send_signal(signal.SIGCONT)
        assert rig.until(lambda: taken.read_text() == '3\n5\n')
        assert player.wait(timeout=60) == 0
    finally:
        subscriber.kill()
        subscriber.wait()


def test_start_skips_and_rate_stretches(rig, bag):
    player = Player(rig, bag, Playback(rate=2.0, start=2.0, clock=False))
    player.thread.join(timeout=60)
    assert player.count == 6
    assert rig.until(lambda: len(player.clouds) == 4)
    assert player.stamps() == [3, 3, 4, 4]
    assert not player.clock


def test_loop_starts_again(rig, bag):
    context = Context()
    rclpy.init(context=context, domain_id=rig.domain)
    player = Player(rig, bag, Playback(rate=20.0, loop=True), Node('player', context=context))
    try:
        assert rig.until(lambda: len(player.clouds) > 20)
        assert player.stamps()[:10] == [1, 1, 2, 2, 3, 3, 4, 4, 1, 1]
    finally:
        rclpy.shutdown(context=context)
        player.thread.join(timeout=10)
    assert not player.thread.is_alive()


def test_it_ends_in_a_long_pause_of_a_bag(rig, bag):
    context = Context()
    rclpy.init(context=context, domain_id=rig.domain)
    player = Player(rig, bag, Playback(rate=0.01), Node('player', context=context))
    try:
        assert rig.until(lambda: len(player.clouds) == 2)
    finally:
        rclpy.shutdown(context=context)
        player.thread.join(timeout=10)
    assert not player.thread.is_alive()


def test_it_ends_while_it_waits_for_subscribers(rig, bag):
    context = Context()
    rclpy.init(context=context, domain_id=rig.domain)
    node, counts = Node('player', context=context), []
    thread = threading.Thread(target=lambda: counts.append(replay(bag, Playback(), node)))
    thread.start()
    try:
        topics = ('/source/points', '/target/points', '/truth/transform')
        assert rig.until(lambda: all(rig.node.count_publishers(topic) for topic in topics))
        assert not rig.until(lambda: counts, patience=0.5)  # it waits
    finally:
        rclpy.shutdown(context=context)
        thread.join(timeout=10)
    assert counts == [0]


def mixed_bag(path, kinds):
    """One message of each type, all on topics of their own."""
    with Writer(path, version=VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
        for number, kind in enumerate(kinds):
            definition = {'msgdef': 'int32 data', 'rihs01': 'RIHS01_0'}
            own = definition if kind.startswith('own') else {'typestore': message_types()}
            connection = writer.add_connection(f'/topic_{number}', kind, **own)
            writer.write(connection, 10**9 + number, bytes([0, 1, *[0] * 10]))
    return path


def test_types_that_are_not_installed_are_left_out(rig, tmp_path, capfd):
    path = mixed_bag(tmp_path / 'bag', ['own_msgs/msg/Packet', 'builtin_interfaces/msg/Time'])
    assert replay(path, Playback(), rig.node) == 1
    assert '/topic_0 is left out: own_msgs/msg/Packet is not installed' in capfd.readouterr().err


def test_a_bag_of_nothing_that_is_installed_is_refused(rig, tmp_path):
    path = mixed_bag(tmp_path / 'bag', ['own_msgs/msg/Packet'])
    with pytest.raises(GclError, match='install the ROS packages of own_msgs/msg/Packet'):
        replay(path, Playback(), rig.node)


@pytest.mark.parametrize(('field', 'value'), [('rate', 0.0), ('start', -1.0)])
def test_playback_values_that_make_no_sense_are_refused(field, value):
    with pytest.raises(GclError, match=f'{field} is {value}'):
        Playback(**{field: value})


def test_a_start_after_the_end_is_refused(rig, bag):
    with pytest.raises(GclError, match='holds no messages after 9 s'):
        replay(bag, Playback(start=9.0), rig.node)
