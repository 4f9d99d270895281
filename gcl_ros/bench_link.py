"""`make bench-link`: what arrives of scans over a radio channel, raw and compact, and how old.

Real DDS over UDP between network namespaces on one emulated medium, see `gcl_ros.bench_channel`:

1. A raw scan of 120,000 points and a compact one of 10 kB over 27 (the top rate of 802.11p), 6
   and 3 Mbit/s. A raw one has twice the time that the rate alone takes, so that scans do not
   wait for each other.
2. 2, 5 and 10 vehicles that send compact scans at 10 Hz, each when its sensor turns, on one
   channel to one that takes all.
3. The age of transforms where the source's compact scans come over 6 Mbit/s, and where all is on
   one machine, see `gcl_ros.bench_age`.

Scans are sent and taken as the nodes do it, with a history of one message. Needs root and `ip`
(iproute2), and removes what it made. Nothing else should run.
"""

from __future__ import annotations

import argparse
import json
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core.errors import GclError, bad_input_exits
from gcl_core.files import write_text
from gcl_core.provenance import provenance_for
from gcl_core.to_json import to_json
from gcl_ros.bench_channel import Channel, Conditions
from gcl_ros.bench_end import READY
from gcl_ros.bench_link_age import ages, environment
from gcl_ros.compact_cloud import fill_compact
from gcl_ros.conversions import fill_point_cloud2

POINTS = 120_000
COMPACT = 10_000  # bytes; the median of a real HDL-64E scan is a little less
PERIOD = 0.1  # seconds between scans of a sensor
PATIENCE = 120.0  # seconds for all to find each other over a bad channel, on a busy machine
SETTLE = 2.0  # seconds after that
LAST = 5.0  # seconds for the last messages


@dataclass(frozen=True)
class Case:
    """What is sent.

    Attributes:
        scans: `raw` or `compact`.
        vehicles: that send, each from a station of its own to one more that takes all.
        reliable: whether what is lost is sent again.
        air: conditions of the channel.
        number: scans of each vehicle.
    """

    scans: str
    vehicles: int
    reliable: bool
    air: Conditions
    number: int

    @property
    def size(self) -> int:
        """Bytes of a scan."""
        return 16 * POINTS if self.scans == 'raw' else COMPACT

    @property
    def period(self) -> float:
        """Seconds from one scan to the next."""
        return max(PERIOD, 2 * 8e-6 * self.size / self.air.mbit if self.scans == 'raw' else 0.0)


@dataclass(frozen=True)
class Row:
    """What came of it; times are nan where nothing arrived.

    Attributes:
        received: scans that arrived, of `sent`.
        median_ms: from publication to reception.
        p95_ms: likewise.
        late_ms: by which 95 % of the frames were passed on too late at most: the error of times.
    """

    case: Case
    sent: int
    received: int
    median_ms: float
    p95_ms: float
    late_ms: float


def message(scans: str) -> bytes:
    """A scan as it is published, serialized."""
    if scans == 'compact':
        content = np.random.default_rng(0).bytes(COMPACT)
        return bytes(serialize_message(fill_compact(PointCloud2(), content, PointField)))
    raw = fill_point_cloud2(PointCloud2(), np.zeros((POINTS, 4), np.float32), PointField)
    raw.point_step, raw.row_step = 16, 16 * POINTS
    return bytes(serialize_message(raw))


def measure(case: Case, folder: Path) -> Row:
    """Send what a case says.

    Args:
        case: what.
        folder: for the message and what is received.

    Raises:
        GclError: no channel can be made here, or an end failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    heard, sent = folder / 'received.txt', folder / f'{case.scans}.msg'
    heard.write_text('')
    sent.write_bytes(message(case.scans))
    topics = [f'/vehicle{number}/points' for number in range(case.vehicles)]
    kind = ['--reliable'] if case.reliable else []
    timing = ['--period', str(case.period), '--number', str(case.number)]
    with Channel(case.vehicles + 1, case.air, repr(case)) as channel, ExitStack() as running:

        def end(station: int, *arguments: str, **pipes: Any) -> subprocess.Popen[str]:
            command = [sys.executable, '-m', 'gcl_ros.bench_end', *arguments, *kind]
            started = channel.start(station, command, env=environment(), text=True, **pipes)
            running.callback(_end, started)
            return started

        end(case.vehicles, str(heard), *topics)
        pipes = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE}
        phases = np.random.default_rng(0).uniform(0, case.period, case.vehicles)
        senders = [
            end(number, str(sent), topic, *timing, '--after', f'{phases[number]:.3f}', **pipes)
            for number, topic in enumerate(topics)
        ]
        _wait_for(senders)
        time.sleep(SETTLE)
        for sender in senders:
            print(file=sender.stdin, flush=True)
        time.sleep(case.number * case.period + LAST)
    found = [float(line.split()[1]) for line in heard.read_text().splitlines()]
    return row(case, found, channel.late)


def _wait_for(senders: Sequence[subprocess.Popen[str]]) -> None:
    """Wait until every sender has its listener."""
    until = time.monotonic() + PATIENCE
    for sender in senders:
        assert sender.stdout is not None
        ready, _, _ = select.select([sender.stdout], [], [], max(0.0, until - time.monotonic()))
        if not ready or sender.stdout.readline().strip() != READY:
            raise GclError(f'a sender found no listener within {PATIENCE:.0f} s; see what it said')


def _end(process: subprocess.Popen[str]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()  # for which a sender waits
    process.terminate()
    process.wait(timeout=30)


def row(case: Case, ages_: Sequence[float], late: Sequence[float]) -> Row:
    """From seconds."""
    ms = 1e3 * np.array(ages_ or [np.nan])
    figures = [np.median(ms), np.percentile(ms, 95), 1e3 * np.percentile(late or [0.0], 95)]
    rounded = [round(float(figure), 1) for figure in figures]
    return Row(case, case.vehicles * case.number, len(ages_), *rounded)


def cases(o: argparse.Namespace) -> list[Case]:
    """All that is sent, from the command line."""
    alone = [
        Case(scans, 1, reliable, Conditions(mbit, loss, o.delay), number)
        for mbit in o.mbit
        for loss in sorted({0.0, o.loss})
        for scans, number in (('raw', o.raw), ('compact', o.number))
        for reliable in (False, True)
    ]
    together = [
        Case('compact', vehicles, reliable, Conditions(o.channel, loss, o.delay), o.number)
        for vehicles in o.vehicles
        for loss in sorted({0.0, o.loss})
        for reliable in (False, True)
    ]
    return [case for case in (*alone, *together) if case.number]


def table(found: Sequence[Row]) -> str:
    """As Markdown."""
    lines = [
        '| Mbit/s | lost, % | vehicles | scans | reliable | received | median, ms | p95, ms |'
    ]
    lines.append('|---|---|---|---|---|---|---|---|')
    for r in found:
        c = r.case
        where = f'{c.air.mbit:g} | {100 * c.air.loss:g} | {c.vehicles}'
        what = f'{c.scans} | {"yes" if c.reliable else "no"}'
        lines.append(f'| {where} | {what} | {r.received}/{r.sent} | {r.median_ms} | {r.p95_ms} |')
    return '\n'.join(lines)


def parser() -> argparse.ArgumentParser:
    """Of the command line."""
    made = argparse.ArgumentParser(prog='bench_link', description=__doc__)
    made.add_argument('--out', type=Path, default=Path('build/link/link.json'))
    made.add_argument('--folder', type=Path, default=Path('build/link'), help='for logs')
    made.add_argument('--mbit', type=float, nargs='*', default=[27.0, 6.0, 3.0])
    made.add_argument('--vehicles', type=int, nargs='*', default=[2, 5, 10])
    made.add_argument('--channel', type=float, default=10.0, help='Mbit/s that they share')
    made.add_argument('--loss', type=float, default=0.05, help='share of frames, beside none')
    made.add_argument('--delay', type=float, default=0.02, help='seconds')
    made.add_argument('--number', type=int, default=100, help='compact scans of each; 0: none')
    made.add_argument('--raw', type=int, default=5, help='raw scans; 0: none')
    made.add_argument('--age', type=float, default=6.0, help='Mbit/s for transforms; 0: none')
    made.add_argument('--minutes', type=float, default=1.0, help='of transforms')
    return made


def main() -> None:
    """Measure, print the tables and write them as JSON."""
    o = parser().parse_args()
    with bad_input_exits('bench_link'):
        here = provenance_for(o.out)
        found = []
        for case in cases(o):
            found.append(measure(case, o.folder))
            print(table(found[-1:]).splitlines()[-1], file=sys.stderr)
        result: dict[str, Any] = {**here, 'rows': [flat(r) for r in found]}
        if o.age:
            air = Conditions(o.age, o.loss, o.delay)
            result['transforms'] = ages(air, o.minutes, o.folder / 'age')
        write_text(o.out, to_json(result, indent=1) + '\n')
        print(table(found))
        print(json.dumps(result.get('transforms', {}), indent=1))


def flat(found: Row) -> dict[str, Any]:
    """One row as the JSON has it."""
    case, air = asdict(found.case), asdict(found.case.air)
    kept = {
        **case,
        **air,
        'bytes': found.case.size,
        'period_s': found.case.period,
        **asdict(found),
    }
    return {key: value for key, value in kept.items() if key not in ('case', 'air')}


if __name__ == '__main__':
    main()
