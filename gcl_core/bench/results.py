"""All methods on simulated and recorded pairs, for docs/results.md and the README.

    python -m gcl_core.bench.results --data DIR

Runs `config/bench_simulated.yaml` and, with `--data` or GCL_REAL_DATA, `config/bench_real.yaml`.
What was measured stays in the folder of the runs: a second call goes on where the first was
stopped. Run it when nothing else runs.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core.config import load_config
from gcl_core.errors import bad_input_exits
from gcl_core.evaluation.benchmark import BenchmarkConfig, Ours, Peer
from gcl_core.evaluation.report import Results, gather, write
from gcl_core.evaluation.runner import Run
from gcl_core.evaluation.score import Row
from gcl_core.evaluation.tables import across, recall, summary
from gcl_core.files import write_text
from gcl_core.ops.memory import keep_freed_memory
from gcl_core.provenance import provenance_for
from gcl_core.registrar import RegistrarConfig

CONFIGS = Path(__file__).parents[2] / 'config'


def main(arguments: list[str] | None = None) -> None:
    """Measure, write both files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--data', type=Path, default=os.environ.get('GCL_REAL_DATA') or None)
    parser.add_argument('--out', type=Path, default=Path('docs/results.md'))
    parser.add_argument('--json', type=Path, default=Path('bench/results.json'))
    parser.add_argument('--folder', type=Path, default=Path('build/bench'), help='of the runs')
    parser.add_argument('--per-bin', type=int, help='fewer pairs than the configs say, for a try')
    parser.add_argument('--without', nargs='*', default=[], help='peers to leave out, for a try')
    options = parser.parse_args(arguments)
    with bad_input_exits('results'):
        measure(options)


def measure(options: argparse.Namespace) -> None:
    """Run every benchmark and write what came of it."""
    here, parts, rows = provenance_for(options.out, options.json), [], []
    keep_freed_memory()
    for name in ('simulated', 'real') if options.data else ('simulated',):
        config = adapted(load_config(BenchmarkConfig, CONFIGS / f'bench_{name}.yaml'), options)
        if name == 'real':
            config = replace(config, source=replace(config.source, data=str(options.data)))
        run = Run(config, options.folder / name, provenance=here)
        if run.provenance['commit'] != here['commit']:
            said = f'{run.folder} goes on from commit {run.provenance["commit"]}'
            print(f'{said}; remove it to measure this one alone', file=sys.stderr)
        predictions = run.predict()
        results = gather(run, predictions)
        write(run, predictions, results)
        parts.append(section(run, results))
        rows += [row for r in results.rows for row in flat(run.config, r)]
    write_text(options.json, json.dumps(rows, indent=1) + '\n')
    write_text(options.out, document(parts))
    print(f'wrote {options.out} and {options.json}; pages in {options.folder}')


def adapted(config: BenchmarkConfig, options: argparse.Namespace) -> BenchmarkConfig:
    """Leave out peers that are not wanted or not installed; take fewer pairs if told."""
    without = set(options.without)
    if find_spec('kiss_matcher') is None:
        print('kiss_matcher left out: pip install kiss-matcher', file=sys.stderr)
        without.add('kiss_matcher')
    methods = tuple(m for m in config.methods if not (isinstance(m, Peer) and m.name in without))
    fewer = options.per_bin
    pairs = tuple(replace(p, per_bin=fewer or p.per_bin) for p in config.pairs)
    return replace(config, methods=methods, pairs=pairs)


def flat(config: BenchmarkConfig, row: Row) -> Iterator[dict[str, Any]]:
    """One row as bench/results.json has it; recalls in [0, 1], null where nothing is known."""
    if isinstance(row.bin, str):
        return

    def known(value: float, digits: int) -> float | None:
        return round(value, digits) if np.isfinite(value) else None

    yield {
        'dataset': row.dataset,
        'method': row.method,
        'estimator': config.estimators[row.method],
        'lo_m': row.bin[0],
        'hi_m': row.bin[1],
        'yaw': 'random' if config.random_yaw else 'driven',
        'pairs': row.pairs,
        'rr_strict': round(row.strict / row.pairs, 4),
        'rr_loose': round(row.loose / row.pairs, 4),
        'rte_median_m': known(row.rte_median, 4),
        'rre_median_deg': known(row.rre_median_deg, 4),
        'ms': known(1e3 * row.seconds, 1),
        'peak_mb': known(row.peak_mb, 1),
    }


def section(run: Run, results: Results) -> str:
    """Tables of one run: all distances, each set by distance, the rest, then the published."""
    where = '{cpu}, {threads} threads, at commit {commit}, on {date}'.format(**run.provenance)
    turned = 'by a random heading' if run.config.random_yaw else 'not'
    parts = [
        f'## {run.config.title}',
        f'Measured on {where}. Each source turned {turned}.',
        summary(results.rows).markdown(),
    ]
    for drawn in run.drawn:
        own = [row for row in results.rows if row.dataset == drawn.dataset]
        parts += [f'### {drawn.dataset}', f'{drawn.pairs.label}.', recall(own).markdown()]
    for name, rows in results.breakdowns.items():
        parts += [f'### Strict recall by {name}', across(rows).markdown()]
    for table in (*results.more, *(published.table for published in results.published)):
        parts += [f'### {table.title}', table.markdown(), table.note]
    return '\n\n'.join(parts) + '\n'


def document(parts: list[str]) -> str:
    """The whole of docs/results.md."""
    best = Ours(give=('accepted', 'best')).labels['best']
    return (
        '# Results\n\n'
        'Written by `make bench DATA=DIR`; the numbers are in '
        '[bench/results.json](../bench/results.json). Weights: '
        f'{RegistrarConfig().weights}, trained on simulated streets alone.\n\n'
        'Recall in percent with its 95 % Wilson interval: strict is 0.6 m and 1.5°, loose 2 m and '
        '5°. *wrong* counts transforms given that miss the loose criterion; GCL-ROS withholds '
        f'what it is not sure of, which *{best}* gives too, and the peers do not judge what they '
        'give. mRR is the mean over the bins. RTE and RRE are means over loosely registered '
        'pairs, s is the median of a pair, MB the growth of memory on the last pair of a bin. '
        'Pairs of one drive are correlated, so that the true uncertainty is larger than the '
        'intervals. What is marked as published was not measured here. '
        '[The methods](evaluation.md#methods); [what the rows say, and how good the truth is]'
        '(measured.md#make-bench).\n\n' + '\n'.join(parts)
    )


if __name__ == '__main__':
    main()
