"""`gcl evaluate`: a benchmark from its YAML, or one made of the flags; recall by distance."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any, cast

from gcl_core.bench.measure import provenance
from gcl_core.cli.source import add_source
from gcl_core.config import load_config
from gcl_core.errors import GclError
from gcl_core.estimation.estimators import ESTIMATORS
from gcl_core.evaluation.benchmark import (
    BenchmarkConfig,
    Estimators,
    MethodConfig,
    Ours,
    PairsConfig,
    Peer,
    SourceConfig,
)
from gcl_core.evaluation.compare import PAPER
from gcl_core.evaluation.peers import PEERS
from gcl_core.evaluation.report import gather, write
from gcl_core.evaluation.runner import Run
from gcl_core.registrar import RegistrarConfig
from gcl_core.training.distributed import Processes, processes

FEATURES = ('ours', 'fpfh')


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'evaluate',
        help='measure recall by distance',
        description='Run a benchmark. A run with --out that was stopped goes on where it was; '
        'torchrun shares it among processes.',
        epilog='Examples: gcl evaluate --config config/bench_kitti.yaml --data DIR --out out; '
        'gcl evaluate --data DIR --sequence 08 --peers fpfh --random-yaw',
    )
    add_source(parser, required=False, several=True)
    parser.add_argument('--config', type=Path, help='YAML of BenchmarkConfig')
    parser.add_argument('--out', type=Path, help='folder: predictions, results, report.html')
    parser.add_argument('--pairs', type=Path, help='list of pairs, as `gcl pairs` writes it')
    parser.add_argument('--per-bin', type=int, help='random pairs in each distance bin (16)')
    parser.add_argument('--seed', type=int, help='of the pairs and of the headings (0)')
    parser.add_argument('--random-yaw', action='store_true', help='turn each source at random')
    own = parser.add_argument_group('methods, without --config')
    own.add_argument('--registrar', type=Path, help='YAML of RegistrarConfig')
    own.add_argument('--peers', nargs='*', default=[], choices=sorted(PEERS), help='also run')
    own.add_argument(
        '--estimators',
        nargs='+',
        default=[],
        choices=(*ESTIMATORS, PAPER),
        help='compare estimators instead: best-supported transform, refined, none withheld',
    )
    own.add_argument(
        '--features', nargs='+', default=list(FEATURES), choices=FEATURES, help='for estimators'
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Predict, score, print a table."""
    config = benchmark(options)
    with processes(patience=timedelta(days=7)) as own:
        if options.out:
            _evaluate(config, options.out, own)
        else:
            with tempfile.TemporaryDirectory() as folder:
                _evaluate(config, Path(folder), own, kept=False)
    return 0


def _evaluate(config: BenchmarkConfig, folder: Path, own: Processes, *, kept: bool = True) -> None:
    benchmark_ = Run(config, folder, own, provenance=provenance())
    predictions = benchmark_.predict()
    if not own.first:
        return
    results = gather(benchmark_, predictions)
    turned = 'at random' if config.random_yaw else 'not'
    for drawn in benchmark_.drawn:
        print(f'{drawn.pairs.label}, source turned {turned}')
    print('\n\n'.join(table.markdown() for table in results.tables[:2]))
    if kept:
        write(benchmark_, predictions, results)
        print(f'wrote {folder}/results.json, results.md and report.html')


def benchmark(options: argparse.Namespace) -> BenchmarkConfig:
    """The config of the command line: that of `--config`, or one made of flags."""
    if options.config:
        if options.registrar or options.peers or options.estimators:
            raise GclError('methods stand in --config; leave the flags out, or --config')
        config = load_config(BenchmarkConfig, options.config)
    else:
        config = BenchmarkConfig(methods=_methods(options))
    config = replace(config, source=_source(options, config.source))
    if options.random_yaw:
        config = replace(config, random_yaw=True)
    if options.seed is not None:
        config = replace(config, seed=options.seed)
    if options.pairs:
        limit = config.pairs[0].limit if config.pairs else 0
        listed = PairsConfig(kind='list', file=str(options.pairs), limit=limit)
        config = replace(config, pairs=(listed,))
    elif options.per_bin is not None or not options.config:
        per_bin = 16 if options.per_bin is None else options.per_bin
        if per_bin < 1:
            raise GclError(f'--per-bin is {per_bin}; it must be at least 1')
        config = replace(config, pairs=(PairsConfig(per_bin=per_bin, seed=config.seed),))
    return config


def _source(options: argparse.Namespace, source: SourceConfig) -> SourceConfig:
    if options.simulated is not None:
        return replace(source, data='', sequences=(), simulated=(options.simulated,))
    if options.data:
        source = replace(source, data=str(options.data), simulated=())
    if options.sequence:
        source = replace(source, sequences=tuple(options.sequence))
    return replace(source, layout=options.format or source.layout)


def _methods(options: argparse.Namespace) -> tuple[MethodConfig, ...]:
    path = options.registrar
    registrar = load_config(RegistrarConfig, path) if path else RegistrarConfig()
    if options.estimators:
        names, features = tuple(options.estimators), tuple(options.features)
        return (Estimators(names=names, features=features, registrar=registrar),)
    peers = tuple(Peer(name=cast(Any, name)) for name in options.peers)
    return (Ours(registrar=registrar), *peers)
