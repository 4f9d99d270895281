"""A pair of scans to a verdict, whole and stage by stage: `make bench-registration`.

    python -m gcl_core.bench.registration --data DRIVES --out bench/registration.json

Two HDL-64E scans some 20 m apart, of a recorded drive if there is one, else simulated; the source
is turned by 0.3 rad. One row for each instruction set that this machine can run, each measured by
a process of its own, with the shipped weights. KISS-Matcher with its GICP registers the same
clouds in the same process, where it is installed (`evaluation.peers`).
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from gcl_core import se3
from gcl_core.bench.measure import milliseconds
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError, bad_input_exits
from gcl_core.estimation.decision import examine
from gcl_core.estimation.estimators import estimate
from gcl_core.estimation.refine import prepare
from gcl_core.estimation.surface import surface
from gcl_core.evaluation.peers import PEERS
from gcl_core.matching.match import match
from gcl_core.matching.vote import likeliest_first
from gcl_core.ops.memory import keep_freed_memory
from gcl_core.ops.native.instructions import SWITCH, available
from gcl_core.provenance import provenance_for
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import PointCloud

SEED = 900  # of the street; training takes other worlds
APART = 20.0  # metres
YAW = 0.3  # radians


def main() -> None:
    """Measure every instruction set, print a table, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('bench/registration.json'))
    parser.add_argument('--data', type=Path, help="folder of recorded drives in KITTI's layout")
    parser.add_argument('--sequence', default='80', help='of them')
    parser.add_argument('--repeats', type=int, default=15)
    parser.add_argument('--one', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args()
    with bad_input_exits('registration'):
        if options.one:
            print(json.dumps(measured(options)))
            return
        here = provenance_for(options.out)
        rows = [in_process(instructions.name) for instructions in available()]
    print('| instructions | ' + ' | '.join(rows[0]['ms']) + ' |')
    print('|---' * (1 + len(rows[0]['ms'])) + '|')
    for row in rows:
        print(f'| {row["instructions"]} |', ' | '.join(f'{v}' for v in row['ms'].values()), '|')
    options.out.write_text(json.dumps({'rows': rows, **here}, indent=2) + '\n')


def in_process(instructions: str) -> dict[str, Any]:
    """Measure one instruction set in a process of its own: kernels are loaded once."""
    command = [sys.executable, '-m', 'gcl_core.bench.registration', *sys.argv[1:], '--one']
    environment = {**os.environ, SWITCH: instructions}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise GclError(f'{instructions}: {done.stderr.strip()}')
    return dict(json.loads(done.stdout.splitlines()[-1]))


def measured(options: argparse.Namespace) -> dict[str, Any]:
    """All figures of this process's instruction set."""
    keep_freed_memory()  # as the nodes do
    source, target = fixture(options)
    any_heading, known = Registrar(), Registrar(RegistrarConfig(headings=1))
    whole = {
        'any_heading_ms': lambda: any_heading.register(source=source, target=target),
        'known_heading_ms': lambda: known.register(source=source.moved(back()), target=target),
        'describe_ms': lambda: any_heading.model.describe_headings(source),
    }
    own = {name: round(milliseconds(run, options.repeats), 1) for name, run in whole.items()}
    ms = {**own, **kiss_matcher(source, target, own['any_heading_ms'])}
    result = any_heading.register(source=source, target=target)
    return {
        'instructions': os.environ[SWITCH],
        'precision': str(any_heading.model.dtype).split('.')[1],
        'points': [len(source), len(target)],
        'accepted': result.accepted,
        'ms': ms,
        'stages': stages(any_heading, source, target, options.repeats),
    }


def kiss_matcher(source: PointCloud, target: PointCloud, ours: float) -> dict[str, float | None]:
    """Its time and ours over it; None where it is not installed."""
    try:
        register = PEERS['kiss_matcher']()
    except GclError:
        return {'kiss_matcher_ms': None, 'ratio_to_kiss_matcher': None}
    theirs = milliseconds(lambda: register(source, target), 5)
    return {
        'kiss_matcher_ms': round(theirs, 1),
        'ratio_to_kiss_matcher': round(ours / theirs, 3),
    }


def back() -> Any:
    """What undoes the turn of the source."""
    return se3.from_xyz_rpy(yaw=-YAW)


def fixture(options: argparse.Namespace) -> tuple[PointCloud, PointCloud]:
    """Source and target."""
    drive: Sequence = SimulatedSequence(SEED)
    if options.data:
        drive = KittiSequence(options.data, options.sequence)
    target = len(drive) // 2
    origin = drive.T_world_lidar(target)[:3, 3]
    away = [
        float(((drive.T_world_lidar(i)[:3, 3] - origin) ** 2).sum() ** 0.5)
        for i in range(target, len(drive))
    ]
    source = target + min(range(len(away)), key=lambda i: abs(away[i] - APART))
    return drive.scan(source).moved(se3.from_xyz_rpy(yaw=YAW)), drive.scan(target)


def stages(
    registrar: Registrar, source: PointCloud, target: PointCloud, repeats: int
) -> dict[str, dict[str, float]]:
    """Each stage by itself, on what the stages before it gave."""
    config = registrar.config
    view, seen = registrar.views(source=source, target=target)
    look = next(registrar.looks(source=view, target=seen))
    pair, dtype = {'source': look, 'target': seen}, registrar.model.dtype
    find = partial(
        match, source=look.features, target=seen.features, config=config.match, dtype=dtype
    )
    matches = find()
    hypotheses, _ = registrar.hypotheses(registrar.search(seen, Stopwatch()), look)
    scene = registrar.scene(**pair)
    examined = examine(hypotheses, scene, config.verify)
    odds = registrar.calibration.estimated.choice.log_odds(examined)
    work: dict[str, Callable[[], Any]] = {
        'facing': lambda: registrar.model.facing(source),
        'voxels, heights': lambda: registrar.model.voxelize([source]),
        'describe': lambda: registrar.model.describe_headings(source),
        'surface': lambda: surface(source),
        'prepare': lambda: prepare(source, config.refine),
        'vote': lambda: likeliest_first(view.headings, seen.features, dtype),
        'match': find,
        'estimate': lambda: estimate(matches, config.estimator, max_yaw=registrar.max_yaw),
        'verify': lambda: examine(hypotheses, registrar.scene(**pair), config.verify),
        'refine': lambda: registrar.finalists(hypotheses, odds, scene, **pair),
    }
    return {name: times(run, repeats) for name, run in work.items()}


def times(work: Callable[[], Any], repeats: int) -> dict[str, float]:
    """Shortest and median time of several runs after one to warm up, least processor time."""
    work()
    wall, processor = [], []
    for _ in range(repeats):
        began = time.perf_counter(), time.process_time()
        work()
        wall.append(1e3 * (time.perf_counter() - began[0]))
        processor.append(1e3 * (time.process_time() - began[1]))
    figures = {
        'min_ms': min(wall),
        'median_ms': statistics.median(wall),
        'processor_ms': min(processor),
    }
    return {name: round(value, 2) for name, value in figures.items()}


if __name__ == '__main__':
    main()
