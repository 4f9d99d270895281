"""`gcl simulate`: drives through simulated places, as KITTI folders or as a bag."""

from __future__ import annotations

import argparse

from gcl_core import se3
from gcl_core.cli.outcome import Answer
from gcl_core.data.kitti_writer import write_kitti
from gcl_core.data.simulator.meeting import meet
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.progress import progress


def run(options: argparse.Namespace) -> Answer:
    """Drive and write."""
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
    vehicles = f'{len(drives)} vehicle(s), {place}'
    return Answer(f'wrote {count} scans of {vehicles}, to {options.out}')


def _write_bag(
    options: argparse.Namespace,
    target: SimulatedSequence,
    source: SimulatedSequence,
    indices: range,
) -> None:
    """Write both vehicles' scans of the same moments, the second vehicle as the source."""
    from gcl_ros.bag import pair_encounters, write_bag

    period = target.stamp(1) - target.stamp(0)
    pairs = progress([(i, i) for i in indices], unit='pair')
    write_bag(options.out, pair_encounters(source, target, pairs, period), options.storage)
