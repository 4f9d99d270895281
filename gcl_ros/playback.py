"""A bag onto its topics, with the clock, at a rate."""

from __future__ import annotations

import importlib
import re
import time
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Connection
from rosgraph_msgs.msg import Clock

from gcl_core.errors import GclError
from gcl_ros.bag import CLOUD
from gcl_ros.bag_reader import Bag, open_bag

NAP = 0.2  # seconds: no longer asleep at a time
SETTLE = 2.0  # seconds until a subscriber that we see has seen us too
LINGER = 2.0  # seconds for a busy subscriber to take the last messages, which end with us
DISCOVERY_LIMIT = 60.0  # seconds to wait for a subscriber: a network takes its time to load


def message_class(name: str) -> type | None:
    """Class of a message type such as `sensor_msgs/msg/PointCloud2`; None if not installed.

    Raises:
        GclError: no such name is possible.
    """
    match = re.fullmatch(r'([a-z]\w*)/msg/([A-Z]\w*)', name)
    if match is None:
        raise GclError(f'the bag holds {name!r}, which is no type of messages; is it damaged?')
    package, kind = match.groups()
    try:
        found: type = getattr(importlib.import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        return None
    return found


@dataclass(frozen=True)
class Playback:
    """How to play a bag.

    Attributes:
        rate: bag seconds a wall second.
        start: seconds of the bag to skip.
        loop: start again at the end; stamps then jump back, as they do with `ros2 bag play`.
        clock: publish `/clock`.
        reliable: clouds over reliable publishers; best effort otherwise, as drivers do.
        wait: hold the first message back until every cloud topic has a subscriber.
    """

    rate: float = 1.0
    start: float = 0.0
    loop: bool = False
    clock: bool = True
    reliable: bool = True
    wait: bool = True

    def __post_init__(self) -> None:
        if self.rate <= 0:
            raise GclError(f'rate is {self.rate}; it must be positive')
        if self.start < 0:
            raise GclError(f'start is {self.start}; it must not be negative (seconds)')


def replay(path: Path, playback: Playback, node: Node) -> int:
    """Publish the messages of a bag in order; return how many.

    Topics whose message types are not installed are left out, and the log names them.

    Raises:
        GclError: the bag is missing or damaged, or holds no message after `start`.
    """
    clock = node.create_publisher(Clock, '/clock', 10) if playback.clock else None
    with open_bag(path) as reader:
        begin = reader.start_time + round(playback.start * 1e9)
        if reader.message_count == 0 or begin > reader.end_time:
            raise GclError(f'bag {path} holds no messages after {playback.start:g} s')
        publishers = _publishers(reader, playback, node)
        played = [c for c in reader.connections if c.id in publishers]
        clouds = [publishers[c.id] for c in played if _is_cloud(c)]
        if playback.wait:
            wait_for_subscribers(clouds, node)
        count = 0
        while True:
            began = time.monotonic()
            for connection, stamp, raw in reader.raw(played, start=begin):
                _sleep(began + (stamp - begin) * 1e-9 / playback.rate, node)
                if not node.context.ok():
                    return count
                if clock is not None:
                    now = Clock()
                    now.clock.sec, now.clock.nanosec = divmod(stamp, 10**9)
                    clock.publish(now)
                publishers[connection.id].publish(bytes(raw))
                count += 1
            if not playback.loop:
                break
    for publisher in clouds if playback.reliable else ():
        publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=10))
    _sleep(time.monotonic() + LINGER, node)  # nobody who subscribes best effort acknowledges
    return count


def _sleep(until: float, node: Node) -> None:
    """Sleep to a time of the monotonic clock, or until the node is shut down."""
    while node.context.ok() and (left := until - time.monotonic()) > 0:
        time.sleep(min(left, NAP))


def _is_cloud(connection: Connection) -> bool:
    return connection.msgtype == CLOUD


def _publishers(reader: Bag, playback: Playback, node: Node) -> dict[int, Publisher]:
    """One for each connection; what is no cloud is latched for late joiners.

    Raises:
        GclError: no type of the bag is installed.
    """
    policy = ReliabilityPolicy.RELIABLE if playback.reliable else ReliabilityPolicy.BEST_EFFORT
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publishers = {}
    for connection in reader.connections:
        kind = message_class(connection.msgtype)
        if kind is None:
            what = f'{connection.topic} is left out: {connection.msgtype} is not installed'
            node.get_logger().warning(what)
            continue
        qos = QoSProfile(depth=10, reliability=policy) if _is_cloud(connection) else latched
        publishers[connection.id] = node.create_publisher(kind, connection.topic, qos)
    if not publishers:
        names = ', '.join(sorted({c.msgtype for c in reader.connections}))
        raise GclError(f'nothing to replay: install the ROS packages of {names}')
    return publishers


def wait_for_subscribers(publishers: list[Publisher], node: Node) -> None:
    """Wait until every topic is subscribed to, or the node is shut down.

    Raises:
        GclError: nobody subscribes within a minute.
    """
    until = time.monotonic() + DISCOVERY_LIMIT
    while any(p.get_subscription_count() == 0 for p in publishers):
        if time.monotonic() > until:
            names = ', '.join(p.topic_name for p in publishers)
            raise GclError(f'nobody subscribed to {names} within {DISCOVERY_LIMIT:.0f} s')
        time.sleep(0.05)
        if not node.context.ok():
            return
    time.sleep(SETTLE)
