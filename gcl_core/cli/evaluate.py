"""`gcl evaluate`: a benchmark from its YAML, or one made of the flags; recall by distance."""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any, cast

from gcl_core.cli.outcome import Answer
from gcl_core.config import load_config
from gcl_core.errors import GclError
from gcl_core.evaluation.benchmark import (
    BenchmarkConfig,
    Estimators,
    MethodConfig,
    Ours,
    PairsConfig,
    Peer,
    SourceConfig,
)
from gcl_core.evaluation.report import Results, content, gather, write
from gcl_core.evaluation.runner import Run
from gcl_core.provenance import provenance
from gcl_core.registrar import RegistrarConfig
from gcl_core.to_json import to_json
from gcl_core.training.distributed import Processes, processes


def run(options: argparse.Namespace) -> Answer:
    """Predict and score."""
    config = benchmark(options)
    with processes(patience=timedelta(days=7)) as own:
        if options.out:
            return _evaluate(config, options.out, own, options)
        with tempfile.TemporaryDirectory() as folder:
            return _evaluate(config, Path(folder), own, options)


def _evaluate(
    config: BenchmarkConfig, folder: Path, own: Processes, options: argparse.Namespace
) -> Answer:
    benchmark_ = Run(config, folder, own, provenance=provenance())
    predictions = benchmark_.predict()
    if not own.first:
        return Answer()
    results = gather(benchmark_, predictions)
    if options.out:
        write(benchmark_, predictions, results)
    if options.json:
        return Answer(to_json(content(benchmark_, results)))
    wrote = f'\nwrote {folder}/results.json, results.md and report.html' if options.out else ''
    return Answer(_text(benchmark_, results) + wrote)


def _text(run: Run, results: Results) -> str:
    turned = 'at random' if run.config.random_yaw else 'not'
    straight = ', scans de-skewed' if run.config.source.deskew else ''
    if run.config.source.compact:
        straight += f', compact scans of {run.config.source.compact:g} m'
    labels = [f'{drawn.pairs.label}, source turned {turned}{straight}' for drawn in run.drawn]
    return '\n'.join(labels + ['\n\n'.join(table.markdown() for table in results.tables[:2])])


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
        pairs = tuple(replace(p, seed=options.seed) for p in config.pairs)
        config = replace(config, seed=options.seed, pairs=pairs)
    if options.pairs:
        limit = config.pairs[0].limit if config.pairs else 0
        listed = PairsConfig(kind='list', file=str(options.pairs), limit=limit)
        config = replace(config, pairs=(listed,))
    elif options.per_bin is not None or not options.config:
        per_bin = options.per_bin or PairsConfig.per_bin
        config = replace(config, pairs=(PairsConfig(per_bin=per_bin, seed=config.seed),))
    return config


def _source(options: argparse.Namespace, source: SourceConfig) -> SourceConfig:
    if options.sensor:
        source = replace(source, sensors=tuple(options.sensor))
    if options.simulated is not None and options.sequence:
        raise GclError(f'--sequence {options.sequence[0]} is of --data; --simulated has but one')
    if options.simulated is not None:
        simulated, deskew = (options.simulated,), options.deskew
        return replace(
            source,
            data='',
            sequences=(),
            simulated=simulated,
            deskew=deskew,
            compact=options.compact or source.compact,
        )
    if options.data:
        source = replace(source, data=str(options.data), simulated=())
    if options.sequence:
        source = replace(source, sequences=tuple(options.sequence))
    if options.deskew:
        source = replace(source, deskew=options.deskew)
    if options.compact:
        source = replace(source, compact=options.compact)
    return replace(
        source,
        layout=options.format or source.layout,
        columns=options.columns or source.columns,
    )


def _methods(options: argparse.Namespace) -> tuple[MethodConfig, ...]:
    path = options.registrar
    registrar = load_config(RegistrarConfig, path) if path else RegistrarConfig()
    if options.estimators:
        names, features = tuple(options.estimators), tuple(options.features)
        return (Estimators(names=names, features=features, registrar=registrar),)
    peers = tuple(Peer(name=cast(Any, name)) for name in options.peers)
    return (Ours(registrar=registrar), *peers)
