"""`gcl evaluate`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.choices import ESTIMATORS, PEERS, SENSORS
from gcl_core.cli.parsers.form import add_json, add_source, form
from gcl_core.cli.parsers.quantities import count, seed

FEATURES = ('ours', 'fpfh')


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'evaluate',
        help='measure recall by distance',
        **form(
            'Run a benchmark. A run with --out that was stopped goes on where it was; torchrun\n'
            'shares it among processes.',
            [
                'gcl evaluate --simulated 7 --per-bin 2 --random-yaw --peers fpfh',
                'gcl evaluate --config config/bench_kitti.yaml --data KITTI_DIR --out runs/kitti',
            ],
        ),
    )
    add_source(parser, required=False, several=True)
    parser.add_argument('--config', type=Path, help='YAML of BenchmarkConfig')
    parser.add_argument('--out', type=Path, help='folder: predictions, results, report.html')
    parser.add_argument('--pairs', type=Path, help='list of pairs, as `gcl pairs` writes it')
    parser.add_argument(
        '--sensor',
        nargs='+',
        choices=SENSORS,
        help='of simulated vehicles; of two that meet, both',
    )
    parser.add_argument(
        '--per-bin', type=count, help='random pairs in each distance bin; default: 16'
    )
    parser.add_argument('--seed', type=seed, help='of the pairs and of the headings; default: 0')
    parser.add_argument('--random-yaw', action='store_true', help='turn each source at random')
    _add_what_becomes_of_scans(parser)
    add_json(parser)
    _add_methods(parser)


def _add_methods(parser: argparse.ArgumentParser) -> None:
    """Add what runs where no config says it."""
    own = parser.add_argument_group('methods, without --config')
    own.add_argument('--registrar', type=Path, help='YAML of RegistrarConfig')
    own.add_argument('--peers', nargs='*', default=[], choices=PEERS, help='also run')
    own.add_argument(
        '--estimators',
        nargs='+',
        default=[],
        choices=ESTIMATORS,
        help='compare estimators instead: best-supported transform, refined, none withheld',
    )
    own.add_argument(
        '--features',
        nargs='+',
        default=list(FEATURES),
        choices=FEATURES,
        help='for estimators; default: both',
    )


def _add_what_becomes_of_scans(parser: Any) -> None:
    """Options for what happens to each scan before it is registered."""
    parser.add_argument(
        '--deskew',
        type=float,
        default=0.0,
        metavar='SECONDS',
        help="of a sweep, such as 0.1: straighten scans that carry the vehicle's own motion, as "
        'KITTI raw, by the speed that poses and times.txt tell',
    )
    parser.add_argument(
        '--compact',
        type=float,
        default=0.0,
        metavar='METRES',
        help='voxel size, such as 0.25: send compact scans and register what arrives',
    )
