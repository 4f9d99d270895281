"""`gcl bag`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.choices import STORAGES
from gcl_core.cli.parsers.form import add_columns, add_json, add_layout, form
from gcl_core.cli.parsers.pack import add_compact
from gcl_core.cli.parsers.quantities import count, positive, seed

WRITES = 'Write /target/points, /source/points and /truth/transform as a rosbag2, '
EXAMPLES = {
    'from-kitti': 'gcl bag from-kitti KITTI_DIR 08 bag_08 --distance 30',
    'from-nuscenes': 'gcl bag from-nuscenes NUSCENES_DIR bag_nu --distance 20',
    'from-folder': 'gcl bag from-folder CLOUDS_DIR bag_clouds --distance 10',
    'from-data': 'gcl bag from-data DIR bag_data --pairs 4 --random-yaw',
    'from-simulator': 'gcl bag from-simulator 7 bag_7 --distance 20 --every 20',
    'pack': 'gcl bag pack bag_7 packed_7',
    'info': 'gcl bag info bag_7',
}


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'bag',
        help='write a bag of two vehicles, pack one, or tell what is in one',
        **form(
            f'{WRITES}pack one, or tell what is in one.',
            [EXAMPLES[kind] for kind in ('from-simulator', 'pack', 'info')],
        ),
    )
    kinds = parser.add_subparsers(dest='kind', required=True, metavar='KIND')
    kitti = _kind(kinds, 'from-kitti', 'from a KITTI odometry sequence')
    kitti.add_argument('root', type=Path, help='folder with sequences/ and poses/')
    kitti.add_argument('sequence', help='two digits')
    nuscenes = _kind(kinds, 'from-nuscenes', 'from a log of nuScenes')
    nuscenes.add_argument('root', type=Path, help='folder with samples/ and v1.0-*/')
    nuscenes.add_argument('--sequence', help='log; default: the only one')
    folder = _kind(kinds, 'from-folder', 'from a folder of clouds with poses.txt')
    folder.add_argument('root', type=Path, help='folder of .bin, .pcd, .ply, .npy or .gcl files')
    for kind in (kitti, folder):
        add_columns(kind)
    data = _kind(kinds, 'from-data', 'from any of these, ETH, or a bag of one drive')
    data.add_argument('root', type=Path, help='data set, bag, or folder')
    data.add_argument('--sequence', help='log, scene, topic, …; default: the only one')
    add_layout(data)
    simulator = _kind(kinds, 'from-simulator', 'from a simulated street')
    simulator.add_argument('world', type=seed, help='seed of the street')
    for kind in (kitti, nuscenes, folder, data, simulator):
        _add_pairs(kind)
    _add_pack(kinds)
    what = 'topics, rates, frames, pairs and distances of a bag'
    info = kinds.add_parser('info', help=what, **form(f'Print {what}.', [EXAMPLES['info']]))
    info.add_argument('bag', type=Path, help='rosbag2 folder, or a file .mcap or .db3 of one')
    add_json(info)


def _add_pack(kinds: Any) -> None:
    what = 'a bag whose clouds are compact scans, everything else as it was'
    pack = kinds.add_parser(
        'pack', help=f'write {what}', **form(f'Write {what}.', [EXAMPLES['pack']])
    )
    pack.add_argument('bag', type=Path, help='rosbag2 folder, or a file .mcap or .db3 of one')
    pack.add_argument('out', type=Path, help='folder to write')
    pack.add_argument('--topics', nargs='+', default=[], help='of clouds to pack; default: all')
    pack.add_argument(
        '--odometry',
        metavar='TOPIC',
        help='of poses: de-skew clouds whose points tell times',
    )
    add_compact(pack)
    _add_storage(pack)
    add_json(pack)


def _kind(kinds: Any, name: str, help_: str) -> argparse.ArgumentParser:
    kind: argparse.ArgumentParser = kinds.add_parser(
        name, help=help_, **form(f'{WRITES}{help_}.', [EXAMPLES[name]])
    )
    return kind


def _add_storage(kind: argparse.ArgumentParser) -> None:
    kind.add_argument(
        '--storage', choices=STORAGES, default='mcap', help='of the bag; default: %(default)s'
    )


def _add_pairs(kind: argparse.ArgumentParser) -> None:
    """Add which pairs go into the bag, and how."""
    kind.add_argument('bag', type=Path, help='folder to write')
    what = kind.add_mutually_exclusive_group(required=True)
    what.add_argument('--distance', type=positive, help='the source drives this far ahead, m')
    what.add_argument('--pairs', type=count, help='random pairs in each distance bin')
    what.add_argument('--list', type=Path, help='pairs that `gcl pairs` listed')
    _add_storage(kind)
    kind.add_argument(
        '--period', type=positive, default=1.0, help='seconds between pairs; default: %(default)g'
    )
    kind.add_argument('--every', type=count, default=1, help='take every n-th pair; default: all')
    kind.add_argument(
        '--seed', type=seed, default=0, help='of random pairs and headings; default: %(default)s'
    )
    kind.add_argument('--random-yaw', action='store_true', help='turn each source at random')
