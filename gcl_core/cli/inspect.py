"""`gcl inspect`: what is in a sequence, a pair or a group; real beside simulated."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.cli.source import add_source
from gcl_core.data.formats import open_sequence
from gcl_core.data.overlap import overlap
from gcl_core.data.sequence import Sequence, positions
from gcl_core.data.simulator.kinds import KINDS
from gcl_core.data.simulator.sensors import SENSORS
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.evaluation.plots import birds_eye
from gcl_core.evaluation.statistics import (
    RINGS,
    every,
    group_statistics,
    measure,
)
from gcl_core.evaluation.statistics_plots import Sample, comparison, scan_picture


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'inspect',
        help='show what is in a sequence, a pair or a group',
        description='Count points and voxels of 0.3 m by range, overlap of a pair, groups.',
        epilog='Example: gcl inspect --data DIR --sequence 08 --pair 120 100 --picture pair.png',
    )
    add_source(parser)
    parser.add_argument('--sensor', default='hdl64e', choices=sorted(SENSORS), help='simulated')
    parser.add_argument('--kind', choices=sorted(KINDS), help='kind of simulated place')
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--scan', type=int, metavar='I', help='one scan')
    what.add_argument('--pair', type=int, nargs=2, metavar=('SOURCE', 'TARGET'), help='two scans')
    what.add_argument('--group', type=int, metavar='CENTRE', help='a centre and its neighbours')
    what.add_argument(
        '--compare', type=int, metavar='WORLDS', help='beside scans of this many simulated worlds'
    )
    parser.add_argument('--scans', type=int, default=8, help='scans to count in a sequence')
    parser.add_argument(
        '--hide-scan', action='store_true', help='no scan of the sequence itself in --compare'
    )
    parser.add_argument('--picture', type=Path, help='write a picture here')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Count, print, draw."""
    if options.scans < 1 or (options.compare is not None and options.compare < 1):
        raise GclError('--scans and --compare must be at least 1')
    sequence: Sequence = (
        open_sequence(options.data, options.sequence, layout=options.format)
        if options.data
        else SimulatedSequence(options.simulated, sensor=options.sensor, kind=options.kind)
    )
    if options.pair:
        _show_pair(sequence, options.pair, options.picture)
    elif options.group is not None:
        _show_group(sequence, options.group, options.picture)
    elif options.compare:
        _compare(sequence, options)
    else:
        indices = every(sequence, options.scans) if options.scan is None else [options.scan]
        _show_scans(sequence, indices, options.picture)
    return 0


def _check(sequence: Sequence, *indices: int) -> None:
    for index in indices:
        if not 0 <= index < len(sequence):
            raise GclError(f'{sequence.name} has scans 0 to {len(sequence) - 1}, not {index}')


def _show_scans(sequence: Sequence, indices: list[int], picture: Path | None) -> None:
    _check(sequence, *indices)
    where = positions(sequence)
    length = float(np.linalg.norm(np.diff(where, axis=0), axis=1).sum())
    print(f'{sequence.name}: {len(sequence)} scans, {length:.0f} m driven; counted {indices}')
    clouds = [sequence.scan(i) for i in indices]
    _print_table(_sample(sequence.name, sequence, indices, groups=0))
    if picture:
        names = [f'{sequence.name} scan {i}' for i in indices]
        scan_picture(picture, list(zip(names, clouds, strict=True)))


def _show_pair(sequence: Sequence, pair: list[int], picture: Path | None) -> None:
    _check(sequence, *pair)
    source, target = pair
    T = se3.inverse(sequence.T_world_lidar(target)) @ sequence.T_world_lidar(source)
    clouds = {'source': sequence.scan(source), 'target': sequence.scan(target)}
    shares = (
        overlap(**clouds, T_target_source=T),
        overlap(source=clouds['target'], target=clouds['source'], T_target_source=se3.inverse(T)),
    )
    print(
        f'{sequence.name}: source {source} ({len(clouds["source"])} points), target {target} '
        f'({len(clouds["target"])} points), {np.linalg.norm(T[:3, 3]):.1f} m and '
        f'{np.rad2deg(se3.yaw(T)):.1f}° apart\n'
        f'overlap within 0.45 m: {100 * shares[0]:.0f} % of the source, '
        f'{100 * shares[1]:.0f} % of the target'
    )
    if picture:
        title = f'{sequence.name}, true transform'
        birds_eye(
            picture,
            source=clouds['source'],
            target=clouds['target'],
            T_target_source=T,
            title=title,
        )


def _show_group(sequence: Sequence, centre: int, picture: Path | None) -> None:
    groups = group_statistics(sequence, centre)
    print(
        f'{sequence.name}: centre {centre}, neighbours {list(groups.scans[1:])}\n'
        f'{100 * groups.share:.1f} % of its points form a group, '
        f'{groups.mean_size:.1f} members on average'
    )
    if picture:
        clouds = [(f'{sequence.name} scan {i}', sequence.scan(i)) for i in groups.scans]
        scan_picture(picture, clouds)


def _compare(sequence: Sequence, options: argparse.Namespace) -> None:
    """Print and draw the sequence beside simulated worlds of seeds 1000 and up."""
    indices = every(sequence, options.scans)
    samples = [_sample(sequence.name, sequence, indices, groups=min(4, len(indices)))]
    if options.hide_scan:
        samples = [replace(samples[0], pictures=[])]
    kinds = [options.kind] if options.kind else ['residential', None]
    for kind in kinds:
        parts = []
        for seed in range(1000, 1000 + options.compare):
            drive = SimulatedSequence(seed, sensor=options.sensor, kind=kind)
            parts.append(_sample('', drive, [len(drive) // 2], groups=1))
        scans = [scan for part in parts for scan in part.scans]
        shares = [share for part in parts for share in part.groups]
        name = f'simulated {options.sensor}, {kind or "all kinds"}'
        pictures = [part.pictures[0] for part in (parts[:2] if kind else parts[2:8])]
        samples.append(Sample(name, scans, shares, pictures))
    for sample in samples:
        _print_table(sample)
    if options.picture:
        comparison(options.picture, samples)
        print(f'picture: {options.picture}')


def _sample(name: str, sequence: Sequence, indices: list[int], *, groups: int) -> Sample:
    """Measure scans, and the groups around `groups` of them."""
    clouds = [sequence.scan(i) for i in indices]
    middle = len(indices) // 2
    centres = [indices[i] for i in np.linspace(0, len(indices) - 1, groups + 2).astype(int)[1:-1]]
    shares = [group_statistics(sequence, centre).share for centre in centres]
    return Sample(name, [measure(cloud) for cloud in clouds], shares, [clouds[middle]])


def _print_table(sample: Sample) -> None:
    points, voxels, neighbors = (
        np.array([getattr(scan, field) for scan in sample.scans], dtype=float)
        for field in ('points', 'voxels', 'neighbors')
    )
    print(
        f'{sample.name}: {points.sum(1).mean():.0f} points and {voxels.sum(1).mean():.0f} voxels '
        f'of 0.3 m a scan, {np.mean([s.mean_neighbors for s in sample.scans]):.1f} of 27 '
        'neighbours occupied'
        + (f', {100 * np.mean(sample.groups):.0f} % in groups' if sample.groups else '')
    )
    print('| range, m | points | voxels | neighbours |\n|---|---|---|---|')
    for i in range(len(RINGS) - 1):
        counted = neighbors[:, i][np.isfinite(neighbors[:, i])]
        mean = f'{counted.mean():.1f}' if len(counted) else '–'
        print(
            f'| {RINGS[i]:.0f}–{RINGS[i + 1]:.0f} | {points[:, i].mean():.0f} '
            f'| {voxels[:, i].mean():.0f} | {mean} |'
        )
