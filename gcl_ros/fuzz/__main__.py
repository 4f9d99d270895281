"""`python -m gcl_ros.fuzz`: every target in a process of its own; a table, and JSON."""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from gcl_core.errors import bad_input_exits
from gcl_core.files import write_text
from gcl_core.progress import progress
from gcl_core.provenance import provenance_for
from gcl_ros.fuzz.sandbox import MEMORY, PATIENCE
from gcl_ros.fuzz.targets import targets

LIMIT = 3600  # seconds of a target


def one(name: str, *, inputs: int, seed: int, build: Path) -> dict[str, Any]:
    """Fuzz one target; `failure` says how it ended if not well."""
    folder = build / ''.join(c if c.isalnum() else '_' for c in name)
    folder.mkdir(parents=True, exist_ok=True)
    report = folder / 'report.json'
    report.unlink(missing_ok=True)
    command = [sys.executable, '-m', 'gcl_ros.fuzz.guided', name, '--inputs', str(inputs)]
    command += ['--seed', str(seed), '--folder', str(folder), '--report', str(report)]
    began = time.monotonic()
    with (folder / 'log').open('w') as log:
        try:
            code = subprocess.run(command, stdout=log, stderr=log, timeout=LIMIT).returncode
        except subprocess.TimeoutExpired:
            log.write(f'not done within {LIMIT} s')
            code = None
    row: dict[str, Any] = {'target': name, 'seconds': round(time.monotonic() - began, 1)}
    if code == 0 and report.exists():
        return row | json.loads(report.read_text())
    tail = (folder / 'log').read_text(errors='replace').splitlines()[-12:]
    return row | {'failure': f'exit {code}: ' + ' | '.join(tail), 'input': str(folder / 'last')}


def main() -> None:
    """Parse the command line, fuzz, report; exit code 1 if a reader did harm."""
    parser = argparse.ArgumentParser(prog='fuzz', description=__doc__)
    parser.add_argument('--inputs', type=int, default=100_000, help='of all targets together')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--targets', nargs='+', help='some of them')
    parser.add_argument('--build', type=Path, default=Path('build/fuzz'), help='logs and inputs')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), help='targets at a time')
    parser.add_argument('--out', type=Path, default=Path('bench/fuzz.json'))
    o = parser.parse_args()
    with bad_input_exits('fuzz'):
        here = provenance_for(o.out)
    names = o.targets or list(targets())
    fuzz = partial(one, inputs=-(-o.inputs // len(names)), seed=o.seed, build=o.build)
    rows: list[dict[str, Any]] = []
    pool = ThreadPoolExecutor(o.jobs)
    try:
        for row in progress(pool.map(fuzz, names), total=len(names), unit='target'):
            rows.append(row)
            print(json.dumps(row), flush=True)
    finally:  # what was done is written where somebody ends it
        pool.shutdown(cancel_futures=True)
        failed = report(o, rows, here)
    sys.exit(bool(failed))


def report(o: argparse.Namespace, rows: list[dict[str, Any]], here: dict[str, Any]) -> list[str]:
    """Write the JSON, print how it went, return the targets that did harm."""
    guided = importlib.util.find_spec('atheris') is not None
    content = {
        'inputs': sum(row.get('read', 0) + row.get('refused', 0) for row in rows),
        'engine': 'atheris' if guided else 'mutations without coverage',
        'seed': o.seed,
        'memory_bound_mb': MEMORY >> 20,
        'processor_bound_s': PATIENCE,
        'targets': rows,
        **here,
    }
    write_text(o.out, json.dumps(content, indent=1) + '\n')
    failed = [row['target'] for row in rows if 'failure' in row]
    print(f'{content["inputs"]} inputs, {len(rows)} targets, failed: {failed or "none"}')
    return failed


if __name__ == '__main__':
    main()
