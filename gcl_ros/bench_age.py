"""`python -m gcl_ros.bench_age`: how old transforms are when they come, and what it costs.

Two streams of clouds of 120,000 points, best effort over real DDS from processes of their own,
into a registrar in another: a simulated meeting of two vehicles, see `gcl_ros.bench_stream`. With
`--minutes 30` it is the test for growth of memory and queues. Nothing else should run.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from gcl_core.errors import GclError, bad_input_exits
from gcl_core.evaluation import metrics
from gcl_ros.bench_stream import make, there_and_back
from gcl_ros.conversions import matrix, seconds
from gcl_ros.pairing import SIDES
from gcl_ros.session import process
from gcl_ros.startup import running_ros
from gcl_ros.transport import keep_local
from gcl_ros.usage import growth, usage

READY = 300.0  # seconds that a loaded machine may take to start the node, and the streams
IDLE = 10.0  # seconds without clouds in which the idle node is watched
WARM_UP = 0.25  # of the time, before which memory does not count as growth
COUNTS = (
    'pairs',
    'accepted',
    'withheld',
    'left out',
    'replaced by newer',
    'clouds without partner',
)


@dataclass
class Record:
    """What was seen of the node.

    Attributes:
        stamps: of the transforms, seconds.
        ages: of the transforms when they came in here, seconds.
        estimated: the transforms.
        headings: how many were searched, as the diagnostics said each second.
        waiting: clouds in the queue, likewise.
        watched: (time, CPU seconds, resident bytes) of the node.
        figures: of the last diagnostics.
    """

    stamps: list[float] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    estimated: list[np.ndarray] = field(default_factory=list)
    headings: list[int] = field(default_factory=list)
    waiting: list[int] = field(default_factory=list)
    watched: list[tuple[float, float, int]] = field(default_factory=list)
    figures: dict[str, str] = field(default_factory=dict)


class Watcher(Node):
    """Listens to the registrar of its namespace, which no other program has."""

    def __init__(self, record: Record, namespace: str) -> None:
        super().__init__('watcher', namespace=namespace)
        self.record = record
        self.create_subscription(TransformStamped, 'registrar/transform', self._transform, 50)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)

    def _transform(self, message: TransformStamped) -> None:
        stamp = seconds(message.header.stamp)
        self.record.ages.append(time.time() - stamp)
        self.record.stamps.append(stamp)
        self.record.estimated.append(matrix(message.transform))

    def _diagnosed(self, message: DiagnosticArray) -> None:
        if message.status[0].name != f'{self.get_namespace()[1:]}/registrar':
            return
        figures = {value.key: value.value for value in message.status[0].values}
        self.record.figures = figures
        if 'headings' in figures:
            self.record.headings.append(int(figures['headings']))
            self.record.waiting.append(int(figures['clouds waiting']))


def watch(watcher: Watcher, pid: int, duration: float, period: float) -> None:
    """Listen for some seconds, looking at the node's process once a period."""
    end, due = time.monotonic() + duration, 0.0
    while (now := time.monotonic()) < end:
        if now >= due:
            seen = usage(pid)
            watcher.record.watched.append((time.time(), seen.cpu, seen.resident))
            due = now + period
        rclpy.spin_once(watcher, timeout_sec=0.1)


def measure(
    folder: Path,
    minutes: float,
    rate: float,
    offset: float,
    settings: list[str],
    *,
    compact: bool = False,
    source_in: str = '',
) -> dict[str, Any]:
    """Run everything; return what `summary` makes of it.

    Args:
        folder: for the scans and the logs.
        minutes: of streaming.
        rate: Hz.
        offset: seconds by which the target's stamps are later than the source's.
        settings: `NAME:=VALUE` for the node.
        compact: the source sends compact scans.
        source_in: network namespace of the source; the environment must let it be found there.
    """
    make(folder)
    if not source_in:
        keep_local()
    elsewhere = {'source': ['ip', 'netns', 'exec', source_in] if source_in else []}
    namespace = f'bench_{os.getpid()}'
    ros = ['--ros-args', '-r', f'__ns:=/{namespace}']
    parameters = [part for setting in settings for part in ('-p', setting)]
    record, period = Record(), 1.0 if minutes <= 2 else 10.0
    with running_ros(), ExitStack() as running:
        watcher = Watcher(record, namespace)
        node = running.enter_context(process('registrar', [*ros, *parameters], folder))
        idle = _idle(watcher, node.pid)
        record.watched.clear()
        begin = time.time()
        for side in SIDES:
            first = begin + (offset if side == 'target' else 0.0)
            arguments = [side, str(folder), '--begin', repr(first), '--rate', str(rate), *ros]
            if compact and side == 'source':
                arguments.insert(2, '--compact')
            before = elsewhere.get(side, [])
            stream = process('bench_stream', arguments, folder, name=side, before=before)
            running.enter_context(stream)
        _first(watcher)
        watch(watcher, node.pid, 60 * minutes, period)
        watcher.destroy_node()
    truth = np.load(folder / 'truth.npy', allow_pickle=False)
    return {'idle_cpu_percent': idle, **summary(record, truth, begin=begin, rate=rate)}


def _first(watcher: Watcher) -> None:
    """Wait for the first transform, before which programs start and networks are made ready."""
    until = time.monotonic() + READY
    while not watcher.record.ages:
        if time.monotonic() > until:
            raise GclError(f'no transform came within {READY:.0f} s; see the logs')
        rclpy.spin_once(watcher, timeout_sec=0.1)


def _idle(watcher: Watcher, pid: int) -> float:
    """CPU of the active node without clouds, percent of one core."""
    until = time.monotonic() + READY
    while watcher.record.figures.get('state') != 'active':
        if time.monotonic() > until:
            raise GclError(f'the node was not active within {READY:.0f} s; see registrar.log')
        rclpy.spin_once(watcher, timeout_sec=0.1)
    watch(watcher, pid, 2.0, 2.0)
    first = usage(pid)
    watch(watcher, pid, IDLE, IDLE)
    return round(100 * (usage(pid).cpu - first.cpu) / IDLE, 2)


def summary(record: Record, truth: np.ndarray, *, begin: float, rate: float) -> dict[str, Any]:
    """The figures of a run.

    Args:
        record: what was seen.
        truth: (steps, 4, 4), `T_target_source` of each step.
        begin: stamp of the first cloud, seconds.
        rate: Hz.
    """
    steps = [there_and_back(int((s - begin) * rate + 0.01), len(truth)) for s in record.stamps]
    wrong = sum(
        not metrics.registered(T, truth[step], metrics.LOOSE)
        for T, step in zip(record.estimated, steps, strict=True)
    )
    times, cpu, resident = (np.array(column) for column in zip(*record.watched, strict=True))
    took, minutes = times[-1] - times[0], (times - times[0]) / 60
    work = int(record.figures['accepted']) + int(record.figures['withheld'])
    slope = growth(minutes, resident / 1e6, WARM_UP * minutes[-1])
    return {
        'transforms': len(record.ages),
        'wrong': wrong,
        'age_s': {
            'median': round(float(np.median(record.ages)), 3),
            'p95': round(float(np.percentile(record.ages, 95)), 3),
            'largest': round(float(max(record.ages)), 3),
        },
        'transforms_per_s': round(len(record.ages) / took, 2),
        'cpu_percent': round(100 * (cpu[-1] - cpu[0]) / took, 1),
        'cpu_s_per_pair': round((cpu[-1] - cpu[0]) / max(work, 1), 3),
        'searched_at_one_heading': round(float(np.mean(np.array(record.headings) == 1)), 3),
        'most_clouds_waiting': max(record.waiting, default=0),
        **{key: int(record.figures[key]) for key in COUNTS},
        'resident_mb': {
            'first': round(resident[0] / 1e6, 1),
            'last': round(resident[-1] / 1e6, 1),
            'largest': round(resident.max() / 1e6, 1),
            'growth_per_hour': None if slope is None else round(60 * slope, 2),
            'over_time': [[round(m, 2), round(r / 1e6, 1)] for m, r in zip(minutes, resident)],
        },
        'stages_ms': {k: float(v) for k, v in record.figures.items() if k.endswith(' ms')},
    }


def main() -> None:
    """Parse the command line, measure, write JSON and print it without the long list."""
    parser = argparse.ArgumentParser(prog='bench_age', description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('build/age'), help='scans, logs, JSON')
    parser.add_argument('--minutes', type=float, default=1.0)
    parser.add_argument('--rate', type=float, default=10.0, help='Hz of each stream')
    parser.add_argument('--offset', type=float, default=0.0, help='of the target, seconds')
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME:=VALUE', help='parameter of the node'
    )
    parser.add_argument('--compact', action='store_true', help='compact scans from the source')
    parser.add_argument('--source-in', default='', help='network namespace, see `bench_link`')
    o = parser.parse_args()
    settings = {'minutes': o.minutes, 'rate': o.rate, 'offset': o.offset, 'parameters': o.set}
    settings['compact'] = o.compact
    with bad_input_exits('bench_age'):
        where = {'compact': o.compact, 'source_in': o.source_in}
        figures = measure(o.out, o.minutes, o.rate, o.offset, o.set, **where)
    result = {'settings': settings, 'cores': os.cpu_count(), **figures}
    (o.out / 'age.json').write_text(json.dumps(result, indent=1) + '\n')
    result['resident_mb'].pop('over_time')
    print(json.dumps(result, indent=1))


if __name__ == '__main__':
    main()
