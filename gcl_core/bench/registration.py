"""Every stage between two scans and a verdict, alone and together: `make bench-registration`.

    python -m gcl_core.bench.registration --out bench/registration.json

Two simulated HDL-64E scans 20 m apart, the source turned by 0.3 rad, shipped weights; one row for
each instruction set that this machine can run. KISS-Matcher, where it is installed, registers the
same clouds, with the GICP that it leaves to its users: ours, from its transform.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gcl_core import se3
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import bad_input_exits
from gcl_core.estimation.decision import examine
from gcl_core.estimation.estimators import estimate
from gcl_core.estimation.refine import prepare
from gcl_core.estimation.surface import surface
from gcl_core.matching.keypoints import choose
from gcl_core.matching.match import match
from gcl_core.ops.memory import keep_freed_memory
from gcl_core.provenance import provenance_for
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import PointCloud

SEED = 900  # of the street; training takes other worlds
APART = 20  # scans, a metre each
KEY_POINTS = 5000


def main() -> None:
    """Measure everything, print a table, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('bench/registration.json'))
    parser.add_argument('--repeats', type=int, default=15)
    options = parser.parse_args()
    with bad_input_exits('registration'):
        here = provenance_for(options.out)
    keep_freed_memory()  # as the nodes do
    source, target = fixture()
    registrar = Registrar(RegistrarConfig(turns=1))
    figures = stages(registrar, source, target, options.repeats)
    few = max(1, options.repeats // 3)
    figures |= {f'pair, turns {n}': whole(source, target, n, few) for n in (1, 12)}
    print('| stage | shortest, ms | median, ms | processor, ms |\n|---|---|---|---|')
    for stage, row in figures.items():
        print(f'| {stage} |', ' | '.join(f'{value:.1f}' for value in row.values()), '|')
    content = {'points': [len(source), len(target)], 'stages': figures, **here}
    options.out.write_text(json.dumps(content, indent=2) + '\n')


def fixture() -> tuple[PointCloud, PointCloud]:
    """Source and target."""
    street = SimulatedSequence(SEED)
    middle = len(street) // 2
    turn = se3.from_xyz_rpy(yaw=0.3)
    source = PointCloud(se3.transform(turn, street.scan(middle + APART).points))
    return source, street.scan(middle)


def stages(
    registrar: Registrar, source: PointCloud, target: PointCloud, repeats: int
) -> dict[str, dict[str, float]]:
    """Each stage by itself, on what the stages before it gave."""
    config = registrar.config
    views = {'source': registrar.view(source), 'target': registrar.view(target)}
    few, other = (choose(views[side].headings[0], KEY_POINTS) for side in ('source', 'target'))
    matches = match(source=few, target=other, config=config.match)
    hypotheses, _ = registrar.search(**views, watch=Stopwatch())
    scene = registrar.scene(**views)
    examined = examine(hypotheses, scene, config.verify)
    odds = registrar.calibration.estimated.choice.log_odds(examined)
    work: dict[str, Callable[[], Any]] = {
        'describe': lambda: registrar.model.describe([source]),
        'surface': lambda: surface(source),
        'prepare': lambda: prepare(source, config.refine),
        'match': lambda: match(source=few, target=other, config=config.match),
        'estimate': lambda: estimate(matches, config.estimator, max_yaw=registrar.max_heading(1)),
        'verify': lambda: examine(hypotheses, registrar.scene(**views), config.verify),
        'refine': lambda: registrar.finalists(hypotheses, odds, scene, **views),
    }
    return {name: milliseconds(run, repeats) for name, run in work.items()}


def whole(source: PointCloud, target: PointCloud, turns: int, repeats: int) -> dict[str, float]:
    """Two scans to a verdict."""
    registrar = Registrar(RegistrarConfig(turns=turns))
    return milliseconds(lambda: registrar.register(source=source, target=target), repeats)


def milliseconds(work: Callable[[], Any], repeats: int) -> dict[str, float]:
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
