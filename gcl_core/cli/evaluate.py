"""`gcl evaluate`: recall by distance on a KITTI-layout or simulated sequence."""

from __future__ import annotations

import argparse
import json
import platform
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from gcl_core.config import load_config
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.pairs import draw_pairs
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.estimation.estimators import ESTIMATORS
from gcl_core.evaluation import peers
from gcl_core.evaluation.compare import FEATURES, PAPER, compare
from gcl_core.evaluation.predict import Method, predict
from gcl_core.evaluation.score import markdown, score
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import PointCloud

PEERS: dict[str, Method] = {'fpfh': peers.fpfh_ransac}


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'evaluate',
        help='measure recall by distance',
        description='Register random pairs of a sequence, with peers on the same pairs.',
        epilog='Example: gcl evaluate --kitti DIR --sequence 08 --peers fpfh --random-yaw',
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument('--kitti', type=Path, help='folder with sequences/ and poses/')
    source.add_argument('--simulated', type=int, metavar='SEED', help='a simulated street')
    parser.add_argument('--sequence', default='00', help='sequence in the KITTI folder')
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
    sequence: Sequence = (
        KittiSequence(options.kitti, options.sequence)
        if options.kitti
        else SimulatedSequence(options.simulated)
    )
    config = load_config(RegistrarConfig, options.config) if options.config else RegistrarConfig()
    registrar = Registrar(config)

    pairs = draw_pairs(sequence, per_bin=options.per_bin, seed=options.seed)
    if not pairs:
        raise GclError(f'{sequence.name} has no two scans 5 to 50 m apart')
    yaw_seed = options.seed if options.random_yaw else None
    bar = tqdm(pairs, unit='pair')
    if options.estimators:
        steps = compare(
            registrar,
            options.estimators,
            options.features,
            sequence,
            bar,
            random_yaw_seed=yaw_seed,
        )
    else:
        methods: dict[str, Method] = {'GCL-ROS': _accepted(registrar)}
        methods.update({name: PEERS[name] for name in options.peers})
        steps = predict(methods, sequence, bar, random_yaw_seed=yaw_seed)
    predictions = list(steps)
    rows = score(predictions)
    print(f'{sequence.name}, source turned {"at random" if options.random_yaw else "not"}')
    print(markdown(rows))
    if options.out:
        content = {
            'sequence': sequence.name,
            'config': asdict(config),
            'machine': platform.processor() or platform.machine(),
            'rows': [asdict(row) for row in rows],
            'predictions': [asdict(p) for p in predictions],
        }
        options.out.write_text(json.dumps(content, default=lambda a: a.tolist()) + '\n')
    return 0


def _accepted(registrar: Registrar) -> Method:
    def ours(source: PointCloud, target: PointCloud) -> Any:
        result = registrar.register(source=source, target=target)
        return result.T_target_source if result.accepted else None

    return ours
