"""One vehicle: `python -m gcl_ros.soak.publisher SIDE BAG`, 10 Hz, with what goes wrong with it.

The frame's name ends in the number of the scene, so that a transform tells which two clouds it
was made from, whatever became of their stamps.
"""

from __future__ import annotations

import argparse
import heapq
import time
from pathlib import Path

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

from gcl_ros.bag import FRAMES, read_encounters
from gcl_ros.conversions import fill_point_cloud2
from gcl_ros.soak.faults import Fault, active, schedule
from gcl_ros.startup import running_ros

PERIOD = 0.1  # seconds
SCENE = 20  # ticks that a scene lasts


class Vehicle:
    """What one vehicle sends at each tick.

    Args:
        side: source or target.
        bag: scenes.
        seed: of the faults.
    """

    def __init__(self, side: str, bag: Path, seed: int) -> None:
        self._side = side
        self._rng = np.random.default_rng([seed, 2, side == 'source'])
        self._scenes = []
        for number, encounter in enumerate(read_encounters(bag)):
            message = fill_point_cloud2(PointCloud2(), getattr(encounter, side).points, PointField)
            message.header.frame_id = f'{FRAMES[side]}_{number:02d}'
            self._scenes.append(message)

    def sends(self, tick: int, fault: Fault | None) -> list[tuple[float, PointCloud2, float]]:
        """Delay, message and stamp (seconds after the beginning) of what this tick sends."""
        kind, size = (fault.kind, fault.size) if fault else ('', 0.0)
        message = self._scenes[tick // SCENE % len(self._scenes)]
        stamp, rng = tick * PERIOD, self._rng
        if kind == 'step back':
            stamp -= 5.0 + 60.0 * size
        if kind == 'garbage':
            return [(0.0, message, stamp), (0.05, self._garbage(), stamp)]
        if kind == 'repeat':
            return [(0.01 * k, message, stamp) for k in range(1 + int(rng.integers(3)))]
        if self._side == 'source':
            if kind == 'drop' and rng.random() < 0.5:
                return []
            if kind == 'delay':
                return [(float(rng.uniform(0.0, 1.0)), message, stamp)]
            if kind == 'reorder':
                return [(PERIOD * float(rng.integers(5)), message, stamp)]
            if kind == 'step apart':
                stamp += 2.0 + 8.0 * size
        return [(0.0, message, stamp)]

    def _garbage(self) -> PointCloud2:
        """A cloud that claims more than it carries, or carries nothing of use."""
        points = self._rng.normal(0, 20, (int(self._rng.integers(1, 3000)), 3))
        message = fill_point_cloud2(PointCloud2(), points, PointField)
        message.header.frame_id = f'garbage/{self._side}'
        what = int(self._rng.integers(4))
        if what == 0:
            message.width = 2**31
        elif what == 1:
            message.data = message.data[: len(message.data) // 2]
        elif what == 2:
            message.fields = message.fields[:2]
        else:
            message.data = bytes(self._rng.bytes(len(message.data)))
        return message


def run(o: argparse.Namespace) -> None:
    """Send until the time is up."""
    vehicle, faults = Vehicle(o.side, o.bag, o.seed), schedule(o.seed, o.seconds)
    with running_ros():
        node = Node(f'vehicle_{o.side}')
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        publisher = node.create_publisher(PointCloud2, f'/{o.side}/points', qos)
        waiting: list[tuple[float, int, PointCloud2, float]] = []
        began = _when(o.began)
        tick, count = int((time.time() - began) / PERIOD), 0
        while (now := time.time() - began) < o.seconds:
            while tick * PERIOD <= now:
                for delay, message, stamp in vehicle.sends(tick, active(faults, tick * PERIOD)):
                    count += 1
                    heapq.heappush(waiting, (tick * PERIOD + delay, count, message, stamp))
                tick += 1
            while waiting and waiting[0][0] <= now:
                _, _, message, stamp = heapq.heappop(waiting)
                nanoseconds = round((began + stamp) * 1e9)
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)
                publisher.publish(message)
            time.sleep(0.01)
        node.destroy_node()


def _when(path: Path) -> float:
    """Wait for the run to begin; seconds since the epoch."""
    while not path.exists():
        time.sleep(0.05)
    return float(path.read_text())


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(prog='publisher', description=__doc__)
    parser.add_argument('side', choices=('source', 'target'))
    parser.add_argument('bag', type=Path)
    parser.add_argument('--seed', type=int, required=True)
    parser.add_argument('--began', type=Path, required=True, help='file that tells when')
    parser.add_argument('--seconds', type=float, required=True)
    run(parser.parse_args())


if __name__ == '__main__':
    main()
