"""`python -m gcl_ros.bench_end`: one end of `gcl_ros.bench_link`, a program in a station.

`send` publishes a message that lies in a file again and again, each with the time as its stamp;
it says when somebody listens, and begins when a line comes on its standard input. `receive`
appends a line to a file for each message: its topic, how old it was in seconds. Neither imports
what a vehicle computes with, so that ten of them start on a small machine.
"""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import suppress
from pathlib import Path

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2

from gcl_core.errors import bad_input_exits
from gcl_ros.startup import running_ros

READY = 'ready'  # what a sender says


def main() -> None:
    """Parse the command line and be one end."""
    parser = argparse.ArgumentParser(prog='bench_end', description=__doc__)
    parser.add_argument('file', type=Path, help='the message to send, or the file to append to')
    parser.add_argument('topics', nargs='+', help='one to send on, all to receive')
    parser.add_argument('--reliable', action='store_true')
    parser.add_argument('--period', type=float, help='to send: seconds from one to the next')
    parser.add_argument('--number', type=int, default=1, help='to send')
    parser.add_argument('--after', type=float, default=0.0, help='to send: seconds till the first')
    o = parser.parse_args()
    policy = ReliabilityPolicy.RELIABLE if o.reliable else ReliabilityPolicy.BEST_EFFORT
    qos = QoSProfile(depth=1, reliability=policy)  # as the nodes have it
    ended = suppress(KeyboardInterrupt, ExternalShutdownException)
    with ended, bad_input_exits('bench_end'), running_ros(args=[]):
        node = Node('bench')
        if o.period:
            wanted = {'after': o.after, 'period': o.period, 'number': o.number}
            send(node, qos, o.topics[0], o.file.read_bytes(), **wanted)
        else:
            receive(node, qos, o.topics, o.file)


def send(
    node: Node,
    qos: QoSProfile,
    topic: str,
    serialized: bytes,
    *,
    after: float,
    period: float,
    number: int,
) -> None:
    """Publish a message so many times."""
    publisher = node.create_publisher(PointCloud2, topic, qos)
    message = deserialize_message(serialized, PointCloud2)
    while publisher.get_subscription_count() == 0:
        time.sleep(0.05)
    print(READY, flush=True)
    sys.stdin.readline()
    begin = time.monotonic() + after
    for count in range(number):
        time.sleep(max(0.0, begin + count * period - time.monotonic()))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
        publisher.publish(message)
    sys.stdin.readline()  # what is reliable may still be asked for


def receive(node: Node, qos: QoSProfile, topics: list[str], out: Path) -> None:
    """Append to a file until ended."""
    with out.open('a', buffering=1) as lines:

        def heard(topic: str, message: PointCloud2) -> None:
            stamp = message.header.stamp
            age = time.time() - stamp.sec - 1e-9 * stamp.nanosec
            lines.write(f'{topic} {age:.6f}\n')

        for topic in topics:
            node.create_subscription(PointCloud2, topic, lambda m, t=topic: heard(t, m), qos)
        rclpy.spin(node)


if __name__ == '__main__':
    main()
