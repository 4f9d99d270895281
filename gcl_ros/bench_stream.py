"""`python -m gcl_ros.bench_stream SIDE FOLDER`: one vehicle's LiDAR of `gcl_ros.bench_age`.

Two simulated vehicles approach each other from 45 m to 8 m and part again, over and over. Every
scan is made before: a process here only stamps and publishes, best effort, as a driver does.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.compact.scan import encode
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.types import PointCloud
from gcl_ros.compact_cloud import fill_compact
from gcl_ros.conversions import fill_point_cloud2
from gcl_ros.pairing import SIDES, Side
from gcl_ros.program import own_arguments
from gcl_ros.startup import running_ros

WORLD, KIND = 11, 'mixed'  # a street that training never sees
FAR, NEAR = 45.0, 8.0  # metres apart at the start and at the turn


def make(folder: Path) -> None:
    """Simulate both vehicles, unless `source.npz`, `target.npz` and `truth.npy` exist."""
    if (folder / 'truth.npy').exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    target = SimulatedSequence(WORLD, kind=KIND)
    source = SimulatedSequence(WORLD, kind=KIND, route='oncoming')
    first = len(target) // 2 - 40
    start = next(s for s in range(len(source)) if _distance(source, target, s, first) < FAR)
    steps = []
    while _distance(source, target, start + len(steps), first + len(steps)) > NEAR:
        steps.append((start + len(steps), first + len(steps)))
    for side, sequence, column in (('source', source, 0), ('target', target, 1)):
        clouds = {f'{k:03d}': sequence.scan(step[column]).points for k, step in enumerate(steps)}
        np.savez(folder / f'{side}.npz', allow_pickle=False, **clouds)
    truth = [se3.inverse(target.T_world_lidar(t)) @ source.T_world_lidar(s) for s, t in steps]
    np.save(folder / 'truth.npy', np.stack(truth), allow_pickle=False)


def _distance(source: SimulatedSequence, target: SimulatedSequence, s: int, t: int) -> float:
    apart = source.T_world_lidar(s)[:3, 3] - target.T_world_lidar(t)[:3, 3]
    return float(np.linalg.norm(apart))


def there_and_back(number: int, steps: int) -> int:
    """Which of so many steps comes at a time: 0, 1, 2, 1, 0, 1 of three."""
    place = number % (2 * steps - 2)
    return place if place < steps else 2 * steps - 2 - place


def messages(folder: Path, side: Side, *, compact: bool = False) -> list[PointCloud2]:
    """A cloud for each step: x, y, z and intensity, 16 bytes a point, or a compact scan."""
    made = []
    with np.load(folder / f'{side}.npz', allow_pickle=False) as clouds:
        for name in sorted(clouds):
            if compact:
                data = encode(PointCloud(clouds[name]))
                made.append(fill_compact(PointCloud2(), data, PointField))
                made[-1].header.frame_id = f'{side}_lidar'
                continue
            points = np.column_stack([clouds[name], np.zeros(len(clouds[name]), np.float32)])
            message = fill_point_cloud2(PointCloud2(), points[:, :3], PointField)
            message.fields.append(PointField(name='intensity', offset=12, datatype=7, count=1))
            message.point_step, message.row_step = 16, 16 * len(points)
            message.data = points.astype('<f4').tobytes()
            message.header.frame_id = f'{side}_lidar'
            made.append(message)
    return made


def stream(
    publisher: Publisher,
    clouds: list[PointCloud2],
    begin: float,
    rate: float,
    stop: threading.Event,
) -> None:
    """Publish until it is stopped.

    Args:
        publisher: of clouds.
        clouds: one for each step.
        begin: stamp of the first, seconds of the system's clock.
        rate: Hz.
        stop: ends it.
    """
    number = max(0, math.ceil((time.time() - begin) * rate))
    while not stop.wait(max(0.0, (stamp := begin + number / rate) - time.time())):
        message = clouds[there_and_back(number, len(clouds))]
        nanoseconds = round(stamp * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)
        publisher.publish(message)
        number += 1


def main() -> None:
    """Parse the command line and publish until Ctrl-C or SIGTERM."""
    parser = argparse.ArgumentParser(prog='bench_stream', description=__doc__)
    parser.add_argument('side', choices=SIDES)
    parser.add_argument('folder', type=Path, help='with the scans')
    parser.add_argument('--begin', type=float, required=True, help='first stamp, system seconds')
    parser.add_argument('--rate', type=float, default=10.0, help='Hz')
    parser.add_argument('--compact', action='store_true', help='as the node `sender` sends them')
    o = parser.parse_args(own_arguments(sys.argv[1:]))
    stop = threading.Event()
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(signal_number, lambda *_: stop.set())
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    with running_ros(own_handlers=True):
        node = Node(f'{o.side}_driver')
        publisher = node.create_publisher(PointCloud2, f'{o.side}/points', qos)
        stream(publisher, messages(o.folder, o.side, compact=o.compact), o.begin, o.rate, stop)
        node.destroy_node()


if __name__ == '__main__':
    main()
