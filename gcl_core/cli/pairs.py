"""`gcl pairs`: write a list of scan pairs."""

from __future__ import annotations

import argparse
from pathlib import Path

from gcl_core.cli.outcome import Answer
from gcl_core.data import pair_sets
from gcl_core.data.bin_layout import told_layout
from gcl_core.data.formats import open_sequences
from gcl_core.data.pair_list import PairList, write_pair_list
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError
from gcl_core.files import check_writable
from gcl_core.progress import progress
from gcl_core.to_json import to_json


def run(options: argparse.Namespace) -> Answer:
    """Draw and write."""
    check_writable(options.list)
    columns = told_layout(options.columns)
    opened = open_sequences(options.data, options.sequence, layout=options.format, columns=columns)
    pairs = _draw(options, opened)
    if not pairs.pairs:
        raise GclError(f'{pairs.name}: {options.data} has no such pair')
    write_pair_list(options.list, pairs)
    facts = to_json(_facts(options.list, pairs)) if options.json else ''
    return Answer(facts or f'wrote {pairs.label} to {options.list}')


def _facts(path: Path, pairs: PairList) -> dict[str, object]:
    return {
        'file': path,
        'name': pairs.name,
        'pairs': len(pairs.pairs),
        'sequences': pairs.sequences,
        'sha256': pairs.sha256,
    }


def _draw(options: argparse.Namespace, sequences: dict[str, Sequence]) -> PairList:
    if options.range:
        return pair_sets.distance_set(sequences, *options.range)
    if options.fcgf:
        return pair_sets.fcgf_set(sequences)
    if options.random is not None:
        return pair_sets.random_set(sequences, per_bin=options.random, seed=options.seed)
    with progress(unit='pair') as bar:
        return pair_sets.low_overlap_set(sequences, keep=lambda pair, share: bar.update() and None)
