"""`gcl evaluate`: recall by distance, on a pair list or on random pairs of a sequence."""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from gcl_core.cli.source import add_source
from gcl_core.config import load_config
from gcl_core.data.formats import open_sequences
from gcl_core.data.pair_list import PairList, read_pair_list
from gcl_core.data.pair_sets import random_set
from gcl_core.data.pairs import Pair
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.estimation.estimators import ESTIMATORS
from gcl_core.evaluation import peers
from gcl_core.evaluation.compare import FEATURES, PAPER, compare
from gcl_core.evaluation.predict import Method, Prediction, predict
from gcl_core.evaluation.score import markdown, score
from gcl_core.files import write_text
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import PointCloud

PEERS: dict[str, Method] = {'fpfh': peers.fpfh_ransac}


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'evaluate',
        help='measure recall by distance',
        description='Register listed or random pairs, with peers on the same pairs.',
        epilog='Example: gcl evaluate --kitti DIR --sequence 08 --peers fpfh --random-yaw',
    )
    add_source(parser)
    parser.add_argument('--pairs', type=Path, help='list of pairs, as `gcl pairs` writes it')
    parser.add_argument('--config', type=Path, help='YAML of RegistrarConfig')
    parser.add_argument('--per-bin', type=int, default=16, help='pairs in each distance bin')
    parser.add_argument('--seed', type=int, default=0, help='of the pairs and of the headings')
    parser.add_argument('--random-yaw', action='store_true', help='turn each source at random')
    parser.add_argument('--peers', nargs='*', default=[], choices=sorted(PEERS), help='also run')
    parser.add_argument(
        '--estimators',
        nargs='+',
        default=[],
        choices=(*ESTIMATORS, PAPER),
        help='compare estimators instead: best-supported transform, refined, none withheld',
    )
    parser.add_argument(
        '--features', nargs='+', default=list(FEATURES), choices=FEATURES, help='for estimators'
    )
    parser.add_argument('--out', type=Path, help='write predictions and rows as JSON here')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Predict, score, print a table."""
    if options.per_bin < 1:
        raise GclError(f'--per-bin is {options.per_bin}; it must be at least 1')
    pairs, sequences = _pairs(options)
    config = load_config(RegistrarConfig, options.config) if options.config else RegistrarConfig()
    registrar = Registrar(config)

    yaw_seed = options.seed if options.random_yaw else None
    predictions: list[Prediction] = []
    with tqdm(total=len(pairs.pairs), unit='pair') as bar:
        for name, sequence in sequences.items():
            own = _shown(pairs.of(name, sequence), bar)
            predictions += _predict(registrar, options, sequence, own, yaw_seed)
    rows = score(predictions)
    print(f'{pairs.label}, source turned {"at random" if options.random_yaw else "not"}')
    print(markdown(rows))
    if options.out:
        content = {
            'sequences': [sequence.name for sequence in sequences.values()],
            'pairs': {'name': pairs.name, 'count': len(pairs.pairs), 'sha256': pairs.sha256},
            'config': asdict(config),
            'machine': platform.processor() or platform.machine(),
            'rows': [asdict(row) for row in rows],
            'predictions': [asdict(p) for p in predictions],
        }
        write_text(options.out, json.dumps(content, default=lambda a: a.tolist()) + '\n')
    return 0


def _pairs(options: argparse.Namespace) -> tuple[PairList, dict[str, Sequence]]:
    """The list, read or drawn, and its sequences by the list's names."""
    names = [options.sequence] if options.sequence else None
    if options.simulated is not None:
        names = [str(options.simulated)]
    if options.pairs:
        pairs = read_pair_list(options.pairs)
        names = names or list(pairs.sequences)
        pairs = replace(pairs, pairs=tuple(p for p in pairs.pairs if p.sequence in names))
        if not pairs.pairs:
            raise GclError(f'{options.pairs} lists no pair of {", ".join(names)}')
    sequences: dict[str, Sequence]
    if options.data:
        sequences = open_sequences(options.data, names, layout=options.format)
    else:
        sequences = {str(options.simulated): SimulatedSequence(options.simulated)}
    if not options.pairs:
        pairs = random_set(sequences, per_bin=options.per_bin, seed=options.seed)
        if not pairs.pairs:
            names = [sequence.name for sequence in sequences.values()]
            raise GclError(f'{", ".join(names)}: no two scans 5 to 50 m apart')
    return pairs, sequences


def _shown(pairs: Iterable[Pair], bar: Any) -> Iterator[Pair]:
    for pair in pairs:
        yield pair
        bar.update()


def _predict(
    registrar: Registrar,
    options: argparse.Namespace,
    sequence: Sequence,
    pairs: Iterable[Pair],
    yaw_seed: int | None,
) -> Iterator[Prediction]:
    if options.estimators:
        names, features = options.estimators, options.features
        return compare(registrar, names, features, sequence, pairs, random_yaw_seed=yaw_seed)
    methods: dict[str, Method] = {'GCL-ROS': _accepted(registrar)}
    methods.update({name: PEERS[name] for name in options.peers})
    return predict(methods, sequence, pairs, random_yaw_seed=yaw_seed)


def _accepted(registrar: Registrar) -> Method:
    def ours(source: PointCloud, target: PointCloud) -> Any:
        result = registrar.register(source=source, target=target)
        return result.T_target_source if result.accepted else None

    return ours
