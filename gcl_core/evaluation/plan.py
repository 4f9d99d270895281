"""Which pairs a benchmark registers: its sequences opened, its sets drawn, its headings chosen."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from gcl_core.compact.scan import CompactConfig
from gcl_core.data import pair_sets
from gcl_core.data.bin_layout import told_layout
from gcl_core.data.compacted import CompactedSequence
from gcl_core.data.deskewed import DeskewedSequence
from gcl_core.data.formats import open_sequences, sequence_names
from gcl_core.data.joined import JoinedSequence
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.pair_list import PairList, read_pair_list
from gcl_core.data.pairs import Pair
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.meeting import meet
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.evaluation.benchmark import BenchmarkConfig, PairsConfig, SourceConfig
from gcl_core.progress import progress

HDL64E = ('hdl64e',)  # of simulated vehicles by default


@dataclass(frozen=True)
class Drawn:
    """A list of pairs and the set in results that it belongs to."""

    dataset: str
    pairs: PairList


@dataclass(frozen=True)
class Task:
    """One pair to be registered by every method.

    Attributes:
        number: of the pair in the run.
        dataset: set in results.
        sequence: short name.
        pair: scans.
        turned: heading to turn the source by, radians.
        weighed: whether memory is measured on it: the last of its set at its distance.
    """

    number: int
    dataset: str
    sequence: str
    pair: Pair
    turned: float
    weighed: bool


def open_source(config: BenchmarkConfig) -> dict[str, Sequence]:
    """Open the sequences by their short names.

    Raises:
        GclError: there is no data, or a list of pairs names none of the sequences.
    """
    source = config.source
    names = list(map(str, source.simulated or source.sequences))
    lists = [_read(pairs, names) for pairs in config.pairs if pairs.kind == 'list']
    listed = list(dict.fromkeys(name for pairs in lists for name in pairs.sequences))
    if source.simulated:
        return {str(seed): simulated(source, seed) for seed in source.simulated}
    if not source.data:
        raise GclError('the benchmark names no data; give --data DIR or --simulated SEED')
    path, layout = Path(source.data), source.layout or None
    if names == ['*']:
        names = sequence_names(path, layout=layout)
    opened = open_sequences(
        path, names or listed or None, layout=layout, columns=told_layout(source.columns)
    )
    return {
        _as_listed(name, listed): _as_received(sequence, source)
        for name, sequence in opened.items()
    }


def _as_received(drive: Sequence, source: SourceConfig) -> Sequence:
    """De-skew a drive, and send its scans, as far as the source says so."""
    if source.deskew:
        drive = _deskewed(drive, source.deskew)
    if source.compact:
        drive = CompactedSequence(drive, CompactConfig(voxel_size=source.compact))
    return drive


def _deskewed(sequence: Sequence, sweep: float) -> Sequence:
    if not isinstance(sequence, KittiSequence):
        raise GclError(
            f'{sequence.name} cannot be de-skewed: that takes times.txt of the KITTI layout'
        )
    return DeskewedSequence(sequence, sequence.times(), sweep=sweep)


def _as_listed(name: str, listed: list[str]) -> str:
    """`08` for `08-suma` where lists say so: a list of scans does not say whose poses to take."""
    short = name.removesuffix('-suma')
    return short if name not in listed and short in listed else name


def simulated(source: SourceConfig, seed: int) -> Sequence:
    """Drive through a world, or let two vehicles meet in it."""
    sensors = source.sensors or HDL64E
    if source.meet is None:
        return _as_received(SimulatedSequence(seed, sensor=sensors[0]), source)
    both = meet(seed, source.meet, sensors=(sensors[0], sensors[-1]))
    received = [_as_received(drive, source) for drive in both]
    return JoinedSequence(f'sim/{seed}', received, [sensors[0], sensors[-1]])


def sensor(source: SourceConfig, sequence: Sequence, index: int) -> str:
    """Name of the sensor that saw a scan; empty if it is not known."""
    if isinstance(sequence, JoinedSequence):
        return sequence.sensor(index)
    return (source.sensors or (HDL64E if source.simulated else ('',)))[0]


def _read(config: PairsConfig, names: list[str]) -> PairList:
    """Read a list; keep the pairs of the named sequences, if any are named."""
    pairs = read_pair_list(Path(config.file))
    kept = tuple(p for p in pairs.pairs if {p.sequence, f'{p.sequence}-suma'} & {*names})
    if names and names != ['*'] and not kept:
        raise GclError(f'{config.file} lists no pair of {", ".join(names)}')
    return replace(pairs, pairs=kept) if kept else pairs


def draw(config: BenchmarkConfig, sequences: dict[str, Sequence]) -> list[Drawn]:
    """Draw or read every set of pairs.

    Raises:
        GclError: no set has a pair.
    """
    groups = [sequences]
    if config.source.each:
        groups = [{name: sequence} for name, sequence in sequences.items()]
    drawn = [
        Drawn(_dataset(config.source, pairs, found), _limited(found, pairs.limit))
        for group in groups
        for pairs in config.pairs
        for found in _lists(pairs, group)
    ]
    if config.pairs and not any(d.pairs.pairs for d in drawn):
        names = ', '.join(sequence.name for sequence in sequences.values())
        wanted = ', '.join(dict.fromkeys(d.pairs.name for d in drawn))
        raise GclError(
            f'{names}: no two scans as far apart as wanted ({wanted}); '
            'random pairs 5 to 50 m apart need the least: --per-bin'
        )
    return [d for d in drawn if d.pairs.pairs]


def _lists(config: PairsConfig, sequences: dict[str, Sequence]) -> Iterator[PairList]:
    if config.kind == 'list':
        yield _read(config, list(sequences))
    elif config.kind == 'distance':
        for low, high in config.ranges:
            yield pair_sets.distance_set(sequences, low, high)
    elif config.kind == 'fcgf':
        yield pair_sets.fcgf_set(sequences)
    elif config.kind == 'low_overlap':
        with progress(unit='pair', desc='overlaps') as bar:
            found = pair_sets.low_overlap_set(sequences, keep=lambda *_: bar.update() and None)
        yield found
    else:
        yield pair_sets.random_set(
            sequences, per_bin=config.per_bin, seed=config.seed, between=config.between
        )


def _dataset(source: SourceConfig, config: PairsConfig, pairs: PairList) -> str:
    """What results call a set: `kitti`, `kitti/08`, `kitti low overlap`, the name of a list."""
    name = pairs.name.split(' ')[0] if config.kind in ('random', 'distance') else pairs.name
    name = config.name or name
    return f'{name}/{pairs.sequences[0]}' if source.each and pairs.pairs else name


def _limited(pairs: PairList, limit: int) -> PairList:
    if not 0 < limit < len(pairs.pairs):
        return pairs
    rows = np.linspace(0, len(pairs.pairs) - 1, limit).round().astype(int)
    kept = tuple(pairs.pairs[i] for i in rows)
    return replace(pairs, name=f'{pairs.name}, {limit} of {len(pairs.pairs)}', pairs=kept)


def tasks(
    config: BenchmarkConfig, drawn: list[Drawn], sequences: dict[str, Sequence]
) -> list[Task]:
    """Number the pairs and choose a heading for each."""
    found: list[Task] = []
    for place, d in enumerate(drawn):
        for k, name in enumerate(name for name in sequences if name in d.pairs.sequences):
            pairs = d.pairs.of(name, sequences[name])
            rng = np.random.default_rng([config.seed, place, k])  # of the first, as of the seed
            turned = rng.uniform(-np.pi, np.pi, len(pairs)) * config.random_yaw
            make = partial(Task, dataset=d.dataset, sequence=name, weighed=False)
            for pair, heading in zip(pairs, turned, strict=True):
                found.append(make(number=len(found), pair=pair, turned=float(heading)))
    last = {(task.dataset, task.pair.bin): task.number for task in found}
    return [replace(t, weighed=last[t.dataset, t.pair.bin] == t.number) for t in found]


def digest(drawn: list[Drawn]) -> str:
    """Hash of all pairs."""
    return hashlib.sha256(' '.join(d.pairs.sha256 for d in drawn).encode()).hexdigest()
