"""`python -m gcl_core.evaluation.false_accepts`: what is accepted that must not be.

    python -m gcl_core.evaluation.false_accepts --pairs 10000 --out bench/trust.json

Each group of about 400 pairs goes to a file of its own, so that a run goes on where it was
stopped and several processes can share the groups; the table is of all files of the sensor.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from gcl_core.data.simulator.sensors import SENSORS
from gcl_core.errors import GclError, bad_input_exits
from gcl_core.evaluation import metrics
from gcl_core.evaluation.accept_tables import Row, by_distance, by_kind, markdown
from gcl_core.evaluation.adversaries import Case, group
from gcl_core.files import check_writable, sha256, write_text
from gcl_core.models import zoo
from gcl_core.progress import progress
from gcl_core.provenance import provenance_for
from gcl_core.registrar import Registrar, RegistrarConfig

PAIRS = 404  # of a group


def judge(registrar: Registrar, case: Case) -> Row:
    """Register one pair."""
    result = registrar.register_views(source=case.source, target=case.target)
    T, true = result.T_target_source, case.T_true
    meets = [
        true is not None and metrics.registered(T, true, criterion)
        for criterion in (metrics.STRICT, metrics.LOOSE)
    ]
    distance = None if true is None else round(float((true[:3, 3] ** 2).sum() ** 0.5), 2)
    return Row(
        case.kind,
        result.headings,
        distance,
        result.accepted,
        round(result.probability, 5),
        meets[0],
        meets[1],
        result.reason,
    )


def measure(
    registrar: Registrar, folder: Path, sensor: str, numbers: Iterable[int], seconds: float
) -> None:
    """Write a file for each group that has none yet; stop after so many seconds."""
    check_writable(folder / sensor)
    began = time.monotonic()
    for number in numbers:
        path = folder / f'{sensor}_{number:04d}.json'
        if path.exists():
            continue
        if time.monotonic() - began > seconds:
            return
        cases = progress(group(registrar, number, sensor), desc=path.stem, unit='pair')
        rows = [asdict(judge(registrar, case)) for case in cases]
        write_text(path, json.dumps(rows) + '\n')


def load(folder: Path, sensor: str) -> list[Row]:
    """Read the rows of all groups of a sensor in a folder."""
    paths = sorted(folder.glob(f'{sensor}_[0-9]*.json'))
    return [Row(**row) for path in paths for row in json.loads(path.read_text())]


def main() -> None:
    """Measure, print the tables, write them."""
    parser = argparse.ArgumentParser(prog='false_accepts', description=__doc__)
    parser.add_argument('--weights', default=RegistrarConfig().weights, help='name or file')
    parser.add_argument('--sensor', choices=SENSORS, default='hdl64e', help='on all vehicles')
    parser.add_argument(
        '--chunks',
        type=Path,
        default=Path('build/trust'),
        help='a file a group, by weights',
    )
    parser.add_argument('--pairs', type=int, default=10_000, help='at least, in whole groups')
    parser.add_argument('--first', type=int, default=0, help='first group')
    parser.add_argument('--last', type=int, help='group after the last; for shards')
    parser.add_argument('--seconds', type=float, default=float('inf'), help='start none after it')
    parser.add_argument('--out', type=Path, help='JSON of the tables')
    o = parser.parse_args()
    with bad_input_exits('false_accepts'):
        run(o)


def run(o: argparse.Namespace) -> None:
    """Run with parsed options."""
    here = provenance_for(*([o.out] if o.out else []))
    registrar = Registrar(RegistrarConfig(weights=o.weights))
    config = registrar.config
    last = o.first - (-o.pairs // PAIRS) if o.last is None else o.last
    judge_files = (zoo.weights_file(o.weights), zoo.calibration_file(o.weights))
    chunks = o.chunks / sha256(*judge_files)[:12]
    measure(registrar, chunks, o.sensor, range(o.first, last), o.seconds)
    rows = load(chunks, o.sensor)
    if not rows:
        raise GclError(f'no group of pairs in {chunks}; ask for more --pairs or --seconds')
    print(markdown(rows))
    if o.out:
        content = {
            'weights': sha256(judge_files[0]),
            'calibration': sha256(judge_files[1]),
            'sensor': o.sensor,
            'min_probability': config.min_probability,
            'headings': config.headings,
            'provenance': here,
            'by_kind': by_kind(rows),
            'true_by_distance': by_distance(rows),
        }
        write_text(o.out, json.dumps(content, indent=1) + '\n')


if __name__ == '__main__':
    main()
