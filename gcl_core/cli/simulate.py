"""`gcl simulate`: drives through simulated places, as KITTI folders or as a bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, get_args

from gcl_core import se3
from gcl_core.data.kitti_writer import write_kitti
from gcl_core.data.simulator.kinds import KINDS
from gcl_core.data.simulator.meeting import Manoeuvre, meet
from gcl_core.data.simulator.sensors import SENSORS
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'simulate',
        help='write simulated drives',
        description='Write one vehicle, or two that meet, in KITTI layout (sequences 00 and 01) '
        'or, two only, as a bag with the true transforms.',
        epilog='Example: gcl simulate 7 out --meet oncoming --sensor hdl64e hdl32e --bag',
    )
    parser.add_argument('world', type=int, help='seed of the world')
    parser.add_argument('out', type=Path, help='folder to write')
    parser.add_argument('--kind', choices=sorted(KINDS), help='kind of place; else by the seed')
    parser.add_argument(
        '--meet', choices=get_args(Manoeuvre), help='a second vehicle that does so'
    )
    parser.add_argument(
        '--sensor',
        nargs='+',
        default=['hdl64e'],
        choices=sorted(SENSORS),
        help='of the first and, if it has another, of the second vehicle',
    )
    parser.add_argument('--spacing', type=float, default=1.0, help='metres between scans')
    parser.add_argument('--scans', type=int, help='scans from the middle of the drive; else all')
    parser.add_argument('--bag', action='store_true', help='write a rosbag2 instead')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Drive and write."""
    if options.spacing <= 0 or (options.scans is not None and options.scans < 1):
        raise GclError('--spacing must be positive and --scans at least 1')
    if len(options.sensor) > (2 if options.meet else 1):
        raise GclError(f'{len(options.sensor)} sensors given; one for each vehicle, see --meet')
    if options.bag and not options.meet:
        raise GclError('a bag holds two vehicles; say how they meet with --meet')
    drives: tuple[SimulatedSequence, ...]
    if options.meet:
        drives = meet(
            options.world,
            options.meet,
            sensors=(options.sensor[0], options.sensor[-1]),
            kind=options.kind,
            spacing=options.spacing,
        )
    else:
        drives = (
            SimulatedSequence(
                options.world,
                sensor=options.sensor[0],
                kind=options.kind,
                spacing=options.spacing,
            ),
        )
    count = len(drives[0]) if options.scans is None else min(options.scans, len(drives[0]))
    first = (len(drives[0]) - count) // 2
    indices = range(first, first + count)
    if options.bag:
        _write_bag(options, drives[0], drives[1], indices)
    else:
        T_origin_world = se3.inverse(drives[0].T_world_lidar(first))
        for number, drive in enumerate(drives):
            stamps = [drive.stamp(i) - drive.stamp(first) for i in indices]
            write_kitti(
                options.out,
                f'{number:02d}',
                drive,
                indices,
                stamps,
                T_origin_world=T_origin_world,
            )
    place = drives[0].world.street.kind_name
    print(f'wrote {count} scans of {len(drives)} vehicle(s), {place}, to {options.out}')
    return 0


def _write_bag(
    options: argparse.Namespace,
    target: SimulatedSequence,
    source: SimulatedSequence,
    indices: range,
) -> None:
    """Write both vehicles' scans of the same moments, the second vehicle as the source."""
    try:
        from gcl_ros.bag import pair_encounters, write_bag
    except ImportError as error:
        raise GclError(f'a bag needs rosbags ({error}): pip install rosbags') from None

    period = target.stamp(1) - target.stamp(0)
    pairs = [(i, i) for i in indices]
    write_bag(options.out, pair_encounters(source, target, pairs, period), options.storage)
