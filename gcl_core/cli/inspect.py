"""`gcl inspect`: what is in a sequence, a pair or a group; real beside simulated."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.cli.outcome import Answer
from gcl_core.data.bin_layout import told_layout
from gcl_core.data.formats import open_sequence
from gcl_core.data.overlap import overlap
from gcl_core.data.sequence import Sequence, T_target_source, positions
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.evaluation.plots import birds_eye, check_picture
from gcl_core.evaluation.statistics import (
    RINGS,
    every,
    group_statistics,
    measure,
)
from gcl_core.evaluation.statistics_plots import Sample, comparison, scan_picture
from gcl_core.progress import progress
from gcl_core.to_json import to_json

Shown = tuple[dict[str, Any], str]  # the same for machines and in words


def run(options: argparse.Namespace) -> Answer:
    """Count and draw."""
    if options.sequence and not options.data:
        raise GclError(f'--sequence {options.sequence} is of --data; --simulated has but one')
    if options.picture:
        check_picture(options.picture)
    columns = told_layout(options.columns)
    sequence: Sequence = (
        open_sequence(options.data, options.sequence, layout=options.format, columns=columns)
        if options.data
        else SimulatedSequence(options.simulated, sensor=options.sensor, kind=options.kind)
    )
    if options.pair:
        facts, text = _pair(sequence, options.pair, options.picture)
    elif options.group is not None:
        facts, text = _group(sequence, options.group, options.picture)
    elif options.compare:
        facts, text = _comparison(sequence, options)
    else:
        indices = every(sequence, options.scans) if options.scan is None else [options.scan]
        facts, text = _scans(sequence, indices, options.picture)
    clouds = getattr(sequence, 'clouds', None)  # of layouts that may hold .bin files
    read = {'columns': str(clouds.layout)} if clouds and clouds.layout else {}
    return Answer(to_json({'sequence': sequence.name, **read, **facts}) if options.json else text)


def _check(sequence: Sequence, *indices: int) -> None:
    for index in indices:
        if not 0 <= index < len(sequence):
            raise GclError(f'{sequence.name} has scans 0 to {len(sequence) - 1}, not {index}')


def _scans(sequence: Sequence, indices: list[int], picture: Path | None) -> Shown:
    _check(sequence, *indices)
    where = positions(sequence)
    length = float(np.linalg.norm(np.diff(where, axis=0), axis=1).sum())
    sample = _sample(sequence.name, sequence, progress(indices, unit='scan'), groups=0)
    if picture:
        clouds = [(f'{sequence.name} scan {i}', sequence.scan(i)) for i in indices]
        scan_picture(picture, clouds)
    facts = {'scans': len(sequence), 'metres': length, 'counted': indices, **_facts(sample)}
    head = f'{sequence.name}: {len(sequence)} scans, {length:.0f} m driven; counted {indices}'
    return facts, f'{head}\n{_table(sample)}'


def _pair(sequence: Sequence, pair: list[int], picture: Path | None) -> Shown:
    _check(sequence, *pair)
    source, target = pair
    T = T_target_source(sequence, source=source, target=target)
    clouds: dict[str, Any] = {'source': sequence.scan(source), 'target': sequence.scan(target)}
    shares = (
        overlap(**clouds, T_target_source=T),
        overlap(source=clouds['target'], target=clouds['source'], T_target_source=se3.inverse(T)),
    )
    if picture:
        title = f'{sequence.name}, true transform'
        birds_eye(picture, **clouds, T_target_source=T, title=title)
    distance, yaw_deg = float(np.linalg.norm(T[:3, 3])), float(np.rad2deg(se3.yaw(T)))
    counts = [len(cloud) for cloud in clouds.values()]
    facts = {
        'source': {'scan': source, 'points': counts[0], 'overlap': shares[0]},
        'target': {'scan': target, 'points': counts[1], 'overlap': shares[1]},
        'T_target_source': T,
        'distance': distance,
        'yaw_deg': yaw_deg,
    }
    return facts, (
        f'{sequence.name}: source {source} ({counts[0]} points), target {target} '
        f'({counts[1]} points), {distance:.1f} m and {yaw_deg:.1f}° apart\n'
        f'overlap within 0.45 m: {100 * shares[0]:.0f} % of the source, '
        f'{100 * shares[1]:.0f} % of the target'
    )


def _group(sequence: Sequence, centre: int, picture: Path | None) -> Shown:
    groups = group_statistics(sequence, centre)
    if picture:
        clouds = [(f'{sequence.name} scan {i}', sequence.scan(i)) for i in groups.scans]
        scan_picture(picture, clouds)
    return asdict(groups), (
        f'{sequence.name}: centre {centre}, neighbours {list(groups.scans[1:])}\n'
        f'{100 * groups.share:.1f} % of its points form a group, '
        f'{groups.mean_size:.1f} members on average'
    )


def _comparison(sequence: Sequence, options: argparse.Namespace) -> Shown:
    """The sequence beside simulated worlds of seeds 1000 and up."""
    indices = every(sequence, options.scans)
    samples = [_sample(sequence.name, sequence, indices, groups=min(4, len(indices)))]
    if options.hide_scan:
        samples = [replace(samples[0], pictures=[])]
    kinds = [options.kind] if options.kind else ['residential', None]
    for kind in kinds:
        parts = []
        for seed in progress(range(1000, 1000 + options.compare), desc=kind, unit='world'):
            drive = SimulatedSequence(seed, sensor=options.sensor, kind=kind)
            parts.append(_sample('', drive, [len(drive) // 2], groups=1))
        scans = [scan for part in parts for scan in part.scans]
        shares = [share for part in parts for share in part.groups]
        name = f'simulated {options.sensor}, {kind or "all kinds"}'
        pictures = [part.pictures[0] for part in (parts[:2] if kind else parts[2:8])]
        samples.append(Sample(name, scans, shares, pictures))
    text = '\n'.join(_table(sample) for sample in samples)
    if options.picture:
        comparison(options.picture, samples)
        text += f'\npicture: {options.picture}'
    return {'samples': [_facts(sample) for sample in samples]}, text


def _sample(name: str, sequence: Sequence, indices: Iterable[int], *, groups: int) -> Sample:
    """Measure scans, and the groups around `groups` of them."""
    clouds = {i: sequence.scan(i) for i in indices}
    own = list(clouds)
    centres = [own[i] for i in np.linspace(0, len(own) - 1, groups + 2).astype(int)[1:-1]]
    shares = [group_statistics(sequence, centre).share for centre in centres]
    middle = clouds[own[len(own) // 2]]
    return Sample(name, [measure(cloud) for cloud in clouds.values()], shares, [middle])


def _means(sample: Sample) -> dict[str, np.ndarray]:
    """Mean of each count in each ring; NaN where no scan has one."""
    means = {}
    for field in ('points', 'voxels', 'neighbors'):
        counts = np.array([getattr(scan, field) for scan in sample.scans], dtype=float)
        found = np.isfinite(counts)
        sums = np.where(found, counts, 0.0).sum(0)
        means[field] = np.where(found.any(0), sums / np.maximum(found.sum(0), 1), np.nan)
    return means


def _facts(sample: Sample) -> dict[str, Any]:
    return {
        'name': sample.name,
        'ring_edges': RINGS,
        **_means(sample),
        'mean_neighbors': np.mean([scan.mean_neighbors for scan in sample.scans]),
        'group_share': np.mean(sample.groups) if sample.groups else None,
    }


def _table(sample: Sample) -> str:
    means = _means(sample)
    lines = [
        f'{sample.name}: {means["points"].sum():.0f} points and {means["voxels"].sum():.0f} '
        f'voxels of 0.3 m a scan, {np.mean([s.mean_neighbors for s in sample.scans]):.1f} of 27 '
        'neighbours occupied'
        + (f', {100 * np.mean(sample.groups):.0f} % in groups' if sample.groups else ''),
        '| range, m | points | voxels | neighbours |\n|---|---|---|---|',
    ]
    for low, high, points, voxels, neighbors in zip(RINGS, RINGS[1:], *means.values()):
        mean = f'{neighbors:.1f}' if np.isfinite(neighbors) else '–'
        lines.append(f'| {low:.0f}–{high:.0f} | {points:.0f} | {voxels:.0f} | {mean} |')
    return '\n'.join(lines)
