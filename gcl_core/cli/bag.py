"""`gcl bag`: bags of two vehicles from recorded drives or from the simulator."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcl_core.cli.source import add_layout
from gcl_core.data.formats import open_sequence
from gcl_core.data.pairs import draw_pairs
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'bag',
        help='write a bag of two vehicles',
        description='Write /target/points, /source/points and /truth/transform as a rosbag2.',
        epilog='Example: gcl bag from-kitti DIR 08 out_bag --distance 30',
    )
    kinds = parser.add_subparsers(
        dest='kind', required=True, metavar='from-kitti|from-data|from-simulator'
    )
    kitti = kinds.add_parser('from-kitti', help='from a KITTI odometry sequence')
    kitti.add_argument('root', type=Path, help='folder with sequences/ and poses/')
    kitti.add_argument('sequence', help='two digits')
    data = kinds.add_parser('from-data', help='from nuScenes, ETH, a bag, a folder of clouds')
    data.add_argument('root', type=Path, help='data set, bag, or folder')
    data.add_argument('--sequence', help='log, scene, topic, …; default: the only one')
    add_layout(data)
    simulator = kinds.add_parser('from-simulator', help='from a simulated street')
    simulator.add_argument('world', type=int, help='seed of the street')
    for kind in (kitti, data, simulator):
        kind.add_argument('bag', type=Path, help='folder to write')
        what = kind.add_mutually_exclusive_group(required=True)
        what.add_argument('--distance', type=float, help='the source drives this far ahead, m')
        what.add_argument('--pairs', type=int, help='random pairs in each distance bin')
        kind.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap')
        kind.add_argument('--period', type=float, default=1.0, help='seconds between pairs')
        kind.add_argument('--every', type=int, default=1, help='take every n-th pair')
        kind.add_argument('--seed', type=int, default=0, help='of random pairs')
        kind.add_argument('--random-yaw', action='store_true', help='turn each source at random')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the bag."""
    from gcl_ros.bag import following, pair_encounters, write_bag

    if options.every < 1 or options.period <= 0:
        raise GclError('--every must be at least 1 and --period positive')
    sequence: Sequence
    if options.kind == 'from-simulator':
        sequence = SimulatedSequence(options.world)
    else:
        layout = 'kitti' if options.kind == 'from-kitti' else options.format
        sequence = open_sequence(options.root, options.sequence, layout=layout)
    if options.distance is not None:
        pairs = following(sequence, options.distance)
    else:
        drawn = draw_pairs(sequence, per_bin=options.pairs, seed=options.seed)
        pairs = [(pair.source, pair.target) for pair in drawn]
    encounters = pair_encounters(
        sequence,
        sequence,
        pairs[:: options.every],
        options.period,
        random_yaw_seed=options.seed if options.random_yaw else None,
    )
    count = write_bag(options.bag, encounters, options.storage)
    print(f'wrote {count} pairs to {options.bag}')
    return 0
