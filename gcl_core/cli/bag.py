"""`gcl bag`: bags of two vehicles, from recorded drives or simulated, and what is in one."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcl_core.cli.source import add_layout
from gcl_core.data.formats import open_sequences
from gcl_core.data.pair_list import PairList, listed, read_pair_list
from gcl_core.data.pair_sets import random_set
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'bag',
        help='write a bag of two vehicles, or tell what is in one',
        description='Write /target/points, /source/points and /truth/transform as a rosbag2.',
        epilog='Example: gcl bag from-kitti DIR 08 out_bag --distance 30',
    )
    kinds = parser.add_subparsers(
        dest='kind', required=True, metavar='from-{kitti,nuscenes,folder,data,simulator}|info'
    )
    kitti = kinds.add_parser('from-kitti', help='from a KITTI odometry sequence')
    kitti.add_argument('root', type=Path, help='folder with sequences/ and poses/')
    kitti.add_argument('sequence', help='two digits')
    nuscenes = kinds.add_parser('from-nuscenes', help='from a log of nuScenes')
    nuscenes.add_argument('root', type=Path, help='folder with samples/ and v1.0-*/')
    nuscenes.add_argument('--sequence', help='log; default: the only one')
    folder = kinds.add_parser('from-folder', help='from a folder of clouds with poses.txt')
    folder.add_argument('root', type=Path, help='folder of .bin, .pcd, .ply or .npy files')
    data = kinds.add_parser('from-data', help='from any of these, ETH, or a bag of one drive')
    data.add_argument('root', type=Path, help='data set, bag, or folder')
    data.add_argument('--sequence', help='log, scene, topic, …; default: the only one')
    add_layout(data)
    simulator = kinds.add_parser('from-simulator', help='from a simulated street')
    simulator.add_argument('world', type=int, help='seed of the street')
    for kind in (kitti, nuscenes, folder, data, simulator):
        kind.add_argument('bag', type=Path, help='folder to write')
        what = kind.add_mutually_exclusive_group(required=True)
        what.add_argument('--distance', type=float, help='the source drives this far ahead, m')
        what.add_argument('--pairs', type=int, help='random pairs in each distance bin')
        what.add_argument('--list', type=Path, help='pairs that `gcl pairs` listed')
        kind.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap')
        kind.add_argument('--period', type=float, default=1.0, help='seconds between pairs')
        kind.add_argument('--every', type=int, default=1, help='take every n-th pair')
        kind.add_argument('--seed', type=int, default=0, help='of random pairs')
        kind.add_argument('--random-yaw', action='store_true', help='turn each source at random')
    parser.set_defaults(run=run)
    info = kinds.add_parser('info', help='topics, rates, frames, pairs and distances of a bag')
    info.add_argument('bag', type=Path, help='rosbag2 folder')
    info.set_defaults(run=show)


def show(options: argparse.Namespace) -> int:
    """Print what is in a bag."""
    from gcl_ros.bag_info import summary

    print(summary(options.bag))
    return 0


def run(options: argparse.Namespace) -> int:
    """Write the bag."""
    from gcl_ros.bag import pair_encounters, write_bag

    if options.every < 1 or options.period <= 0:
        raise GclError('--every must be at least 1 and --period positive')
    sequences: Mapping[str, Sequence]
    if options.kind == 'from-simulator':
        sequences = {str(options.world): SimulatedSequence(options.world)}
    else:
        layout = options.format if options.kind == 'from-data' else options.kind[len('from-') :]
        name = getattr(options, 'sequence', None)
        sequences = open_sequences(options.root, [name] if name else None, layout=layout)
    ((name, sequence),) = sequences.items()
    pairs = _pairs(options, name, sequence)
    pairs = replace(pairs, pairs=pairs.pairs[:: options.every])
    encounters = pair_encounters(
        sequence,
        sequence,
        [(pair.source, pair.target) for pair in pairs.of(name, sequence)],
        options.period,
        random_yaw_seed=options.seed if options.random_yaw else None,
    )
    count = write_bag(options.bag, encounters, options.storage, pair_list=pairs.label)
    print(f'wrote {count} pairs to {options.bag}')
    return 0


def _pairs(options: argparse.Namespace, name: str, sequence: Sequence) -> PairList:
    """The pairs of one drive, read or drawn."""
    from gcl_ros.bag import following

    if options.list:
        pairs = read_pair_list(options.list)
        own = tuple(pair for pair in pairs.pairs if pair.sequence == name)
        if not own:
            raise GclError(f'{options.list} lists no pair of {name}')
        return replace(pairs, pairs=own)
    if options.distance is not None:
        ahead = listed(name, following(sequence, options.distance))
        return PairList(f'{sequence.name} following at {options.distance:g} m', ahead)
    return random_set({name: sequence}, per_bin=options.pairs, seed=options.seed)
