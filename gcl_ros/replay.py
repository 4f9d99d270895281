"""`ros2 run gcl_ros replay BAG`: a bag onto its topics, with the clock, at a rate."""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock

from gcl_core.errors import GclError
from gcl_ros.bag import open_bag

SETTLE = 2.0  # seconds until a subscriber that we see has seen us too
DISCOVERY_LIMIT = 60.0  # seconds to wait for a subscriber: a network takes its time to load


def message_class(name: str) -> type:
    """Class of a message type such as `sensor_msgs/msg/PointCloud2`.

    Raises:
        GclError: its package is not installed.
    """
    package, _, kind = name.split('/')
    try:
        found: type = getattr(importlib.import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        raise GclError(f'the bag holds {name}; install its ROS package {package}') from None
    return found


def replay(path: Path, *, rate: float, wait: bool, node: Node) -> int:
    """Publish every message of a bag in order; return how many.

    Args:
        path: rosbag2 folder.
        rate: bag seconds a wall second.
        wait: hold the first message back until every cloud topic has a subscriber.
        node: publishes.

    Raises:
        GclError: the bag is missing or damaged, or holds no message.
    """
    clock = node.create_publisher(Clock, '/clock', 10)
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with open_bag(path) as reader:
        if reader.message_count == 0:
            raise GclError(f'bag {path} holds no messages')
        publishers = {}
        for connection in reader.connections:
            is_cloud = connection.msgtype.endswith('PointCloud2')
            kind = message_class(connection.msgtype)
            qos = QoSProfile(depth=10) if is_cloud else latched
            publishers[connection.id] = node.create_publisher(kind, connection.topic, qos)
        clouds = [
            publishers[c.id] for c in reader.connections if c.msgtype.endswith('PointCloud2')
        ]
        until = time.monotonic() + DISCOVERY_LIMIT
        while wait and any(p.get_subscription_count() == 0 for p in clouds):
            if time.monotonic() > until:
                names = ', '.join(p.topic_name for p in clouds)
                raise GclError(f'nobody subscribed to {names} within {DISCOVERY_LIMIT:.0f} s')
            time.sleep(0.05)
        if wait:
            time.sleep(SETTLE)
        began, first, count = time.monotonic(), reader.start_time, 0
        for connection, stamp, raw in reader.messages():
            delay = (stamp - first) * 1e-9 / rate - (time.monotonic() - began)
            if delay > 0:
                time.sleep(delay)
            now = Clock()
            now.clock.sec, now.clock.nanosec = divmod(stamp, 10**9)
            clock.publish(now)
            publishers[connection.id].publish(bytes(raw))
            count += 1
    for publisher in clouds:
        publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=10))
    return count


def main() -> None:
    """Parse the command line and replay."""
    parser = argparse.ArgumentParser(prog='replay', description=__doc__)
    parser.add_argument('bag', type=Path, help='rosbag2 folder, as `gcl bag` writes it')
    parser.add_argument('--rate', type=float, default=1.0, help='bag seconds a wall second')
    parser.add_argument('--no-wait', action='store_true', help='do not wait for subscribers')
    arguments = parser.parse_args(remove_ros_args(sys.argv)[1:])
    if arguments.rate <= 0:
        parser.error(f'--rate is {arguments.rate}; it must be positive')
    try:
        with rclpy.init(args=sys.argv):
            node = Node('replay')
            count = replay(
                arguments.bag, rate=arguments.rate, wait=not arguments.no_wait, node=node
            )
            node.get_logger().info(f'{count} messages replayed')
            node.destroy_node()
    except GclError as error:
        print(f'replay: {error}', file=sys.stderr)
        sys.exit(2)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == '__main__':
    main()
