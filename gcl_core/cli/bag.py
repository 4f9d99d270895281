"""`gcl bag`: bags of two vehicles, from recorded drives or simulated; packed; what is in one."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace

from gcl_core.cli.outcome import Answer
from gcl_core.cli.pack import compact_config
from gcl_core.data.bin_layout import told_layout
from gcl_core.data.formats import open_sequences
from gcl_core.data.pair_list import PairList, listed, read_pair_list
from gcl_core.data.pair_sets import random_set
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.files import check_new
from gcl_core.progress import progress
from gcl_core.to_json import to_json


def run(options: argparse.Namespace) -> Answer:
    """Write the bag, or print what is in it."""
    work = {'info': _info, 'pack': _pack}.get(options.kind, _write)
    return Answer(work(options))


def _pack(options: argparse.Namespace) -> str:
    from gcl_ros.bag_packing import in_words, pack_bag

    config = compact_config(options)
    check_new(options.out)
    found = pack_bag(
        options.bag,
        options.out,
        config,
        topics=options.topics,
        odometry=options.odometry,
        storage=options.storage,
    )
    return to_json(found) if options.json else in_words(found)


def _info(options: argparse.Namespace) -> str:
    from gcl_ros.bag_info import in_words, look

    info = look(options.bag)
    return to_json(info) if options.json else in_words(info)


def _write(options: argparse.Namespace) -> str:
    from gcl_ros.bag import pair_encounters, write_bag

    check_new(options.bag)
    sequences: Mapping[str, Sequence]
    if options.kind == 'from-simulator':
        sequences = {str(options.world): SimulatedSequence(options.world)}
    else:
        layout = options.format if options.kind == 'from-data' else options.kind[len('from-') :]
        name = getattr(options, 'sequence', None)
        sequences = open_sequences(
            options.root,
            [name] if name else None,
            layout=layout,
            columns=told_layout(getattr(options, 'columns', None)),
        )
    ((name, sequence),) = sequences.items()
    pairs = _pairs(options, name, sequence)
    pairs = replace(pairs, pairs=pairs.pairs[:: options.every])
    indices = [(pair.source, pair.target) for pair in pairs.of(name, sequence)]
    encounters = pair_encounters(
        sequence,
        sequence,
        progress(indices, unit='pair'),
        options.period,
        random_yaw_seed=options.seed if options.random_yaw else None,
    )
    count = write_bag(options.bag, encounters, options.storage, pair_list=pairs.label)
    return f'wrote {count} pairs to {options.bag}'


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
