"""`python -m gcl_ros.bench_link`: how long clouds take over a slow link, raw and described.

Makes two network namespaces with a link of 27 Mbit/s between them (the top rate of 802.11p), a
publisher in one and a subscriber in the other: real DDS over real sockets. Needs root, `ip` and
`tc` (Debian's iproute2), and removes what it made. What a real radio loses is not emulated.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
import torch
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core.errors import GclError, bad_input_exits
from gcl_core.types import Features
from gcl_ros.conversions import fill_point_cloud2, seconds
from gcl_ros.feature_cloud import Described, fill_feature_cloud
from gcl_ros.playback import wait_for_subscribers
from gcl_ros.startup import running_ros
from gcl_ros.transport import PROFILE_KEYS

POINTS = 120_000
KEYPOINTS = (250, 1000, 5000)
TOPIC = '/points'
QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LAST = 3.0  # seconds for the last message


@contextmanager
def slow_link(mbit: float) -> Iterator[tuple[str, str]]:
    """Two network namespaces with a link of this rate in both directions; yields their names.

    Raises:
        GclError: not root, or `ip` and `tc` are missing.
    """
    if os.geteuid() != 0 or not (shutil.which('ip') and shutil.which('tc')):
        raise GclError('an emulated link needs root and the programs ip and tc (iproute2)')
    names = (f'gcl_{os.getpid()}_a', f'gcl_{os.getpid()}_b')
    for name in names:
        _do('ip', 'netns', 'add', name)
    try:
        ends = f'gcl0 netns {names[0]} type veth peer name gcl0 netns {names[1]}'
        _do('ip', 'link', 'add', *ends.split())
        for number, name in enumerate(names, start=1):
            inside = ['ip', 'netns', 'exec', name]
            _do(*inside, 'ip', 'address', 'add', f'10.77.0.{number}/24', 'dev', 'gcl0')
            for device in ('lo', 'gcl0'):
                _do(*inside, 'ip', 'link', 'set', device, 'up')
            bucket = ['tbf', 'rate', f'{mbit}mbit', 'burst', '4kb', 'limit', '16mb']
            _do(*inside, 'tc', 'qdisc', 'add', 'dev', 'gcl0', 'root', *bucket)
        yield names
    finally:
        for name in names:
            _do('ip', 'netns', 'delete', name)


def _do(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise GclError(f'{" ".join(command)}: {done.stderr.strip()}')


def clouds() -> dict[str, PointCloud2]:
    """What is sent, by name: a raw cloud of 16 bytes a point, and features."""
    rng = np.random.default_rng(0)
    raw = fill_point_cloud2(PointCloud2(), np.zeros((POINTS, 4), np.float32), PointField)
    raw.point_step, raw.row_step = 16, 16 * POINTS
    found = {'raw': raw}
    for count in KEYPOINTS:
        points = torch.from_numpy(rng.uniform(-50, 50, (count, 3)).astype(np.float32))
        descriptors = torch.nn.functional.normalize(torch.randn(count, 32), dim=1)
        features = Described([Features(points, descriptors)], [0.0])
        message = fill_feature_cloud(PointCloud2(), features, 'bench', count, PointField)
        found[f'{count} key points'] = message
    return found


def send(number: int, out: Path) -> None:
    """Publish each cloud so many times; write how long `publish` blocked, in seconds."""
    node = Node('sender')
    publisher = node.create_publisher(PointCloud2, TOPIC, QOS)
    wait_for_subscribers([publisher], node)
    blocked: dict[str, list[float]] = {}
    for name, message in clouds().items():
        message.header.frame_id = name
        for _ in range(number):
            began = time.time()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(
                int(began * 1e9), 10**9
            )
            publisher.publish(message)
            blocked.setdefault(name, []).append(time.time() - began)
            time.sleep(1.0 if name == 'raw' else 0.2)
    out.write_text(json.dumps(blocked))


def receive(out: Path) -> None:
    """Write how long each cloud took, in seconds, whenever one comes, until ended."""
    node, took = Node('receiver'), {}

    def heard(message: PointCloud2) -> None:
        age = time.time() - seconds(message.header.stamp)
        took.setdefault(message.header.frame_id, []).append(age)
        out.write_text(json.dumps(took))

    node.create_subscription(PointCloud2, TOPIC, heard, QOS)
    rclpy.spin(node)


@dataclass(frozen=True)
class Row:
    """One kind of cloud over the link.

    Attributes:
        name: of the kind.
        bytes: of its data.
        received: of those sent, as `20/20`.
        median_ms: from publication to reception.
        p95_ms: likewise.
        blocked_ms: median time that `publish` takes.
    """

    name: str
    bytes: int
    received: str
    median_ms: float
    p95_ms: float
    blocked_ms: float


def measure(out: Path, mbit: float, number: int) -> list[Row]:
    """Send every kind of cloud over the link."""
    out.mkdir(parents=True, exist_ok=True)
    received, blocked = out / 'received.json', out / 'blocked.json'
    environment = {**os.environ, 'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}
    environment |= {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    for key in PROFILE_KEYS:
        environment.pop(key, None)
    with slow_link(mbit) as names:

        def end(where: str, *role: str) -> subprocess.Popen[bytes]:
            command = [sys.executable, '-m', 'gcl_ros.bench_link', *role]
            return subprocess.Popen(['ip', 'netns', 'exec', where, *command], env=environment)

        receiver = end(names[1], '--receive', str(received))
        try:
            sender = end(names[0], '--send', str(blocked), '--number', str(number))
            if sender.wait() != 0:
                raise GclError('the sender failed; see what it said')
            time.sleep(LAST)
        finally:
            receiver.terminate()
            receiver.wait(timeout=30)
    return rows(json.loads(received.read_text()), json.loads(blocked.read_text()))


def rows(took: dict[str, list[float]], blocked: dict[str, list[float]]) -> list[Row]:
    """The table, from seconds by name."""
    sizes = {name: len(message.data) for name, message in clouds().items()}
    found = []
    for name, waits in blocked.items():
        ms = 1e3 * np.array(took.get(name, [np.nan]))
        count = f'{len(took.get(name, []))}/{len(waits)}'
        figures = [np.median(ms), np.percentile(ms, 95), 1e3 * np.median(waits)]
        found.append(Row(name, sizes[name], count, *(round(float(f), 1) for f in figures)))
    return found


def table(found: list[Row]) -> str:
    """As Markdown."""
    lines = ['| cloud | bytes | received | median, ms | p95, ms | publish blocks, ms |']
    lines.append('|---|---|---|---|---|---|')
    for r in found:
        figures = f'{r.median_ms} | {r.p95_ms} | {r.blocked_ms}'
        lines.append(f'| {r.name} | {r.bytes:,} | {r.received} | {figures} |')
    return '\n'.join(lines)


def main() -> None:
    """Parse the command line, measure, print the table and write it as JSON."""
    parser = argparse.ArgumentParser(prog='bench_link', description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('build/link'), help='for JSON')
    parser.add_argument('--mbit', type=float, default=27.0, help='rate of the link, Mbit/s')
    parser.add_argument('--number', type=int, default=20, help='clouds of each kind')
    parser.add_argument('--send', type=Path, help=argparse.SUPPRESS)
    parser.add_argument('--receive', type=Path, help=argparse.SUPPRESS)
    o = parser.parse_args()
    ended = suppress(KeyboardInterrupt, ExternalShutdownException)
    with ended, bad_input_exits('bench_link'):
        if o.send or o.receive:
            with running_ros():
                send(o.number, o.send) if o.send else receive(o.receive)
            return
        found = measure(o.out, o.mbit, o.number)
        result = {'mbit_per_s': o.mbit, 'rows': [vars(row) for row in found]}
        (o.out / 'link.json').write_text(json.dumps(result, indent=1) + '\n')
        print(table(found))


if __name__ == '__main__':
    main()
