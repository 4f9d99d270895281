"""`gcl pairs`: write a list of scan pairs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tqdm import tqdm

from gcl_core.cli.source import add_layout
from gcl_core.data import pair_sets
from gcl_core.data.formats import open_sequences
from gcl_core.data.pair_list import PairList, write_pair_list
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'pairs',
        help='write a list of scan pairs',
        description='Draw pairs as the benchmarks do; results name the list and its hash.',
        epilog='Example: gcl pairs kitti_20_30.txt --data DIR --sequence 08 09 10 --range 20 30',
    )
    parser.add_argument('list', type=Path, help='file to write')
    parser.add_argument('--data', type=Path, required=True, help='data set, bag, or folder')
    parser.add_argument('--sequence', nargs='+', help='KITTI digits, nuScenes logs, …')
    add_layout(parser)
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument(
        '--range', type=int, nargs=2, metavar=('B1', 'B2'), help="the paper's [b1, b2], metres"
    )
    kind.add_argument('--fcgf', action='store_true', help="FCGF's 10 m protocol, KITTI [10,10]")
    kind.add_argument(
        '--low-overlap', action='store_true', help='at most 30 %% overlap: LoKITTI, LoNuScenes'
    )
    kind.add_argument('--random', type=int, metavar='N', help='N random pairs in each bin')
    parser.add_argument('--seed', type=int, default=0, help='of --random')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Draw and write."""
    if options.random is not None and options.random < 1:
        raise GclError(f'--random is {options.random}; it must be at least 1')
    pairs = _draw(options, open_sequences(options.data, options.sequence, layout=options.format))
    if not pairs.pairs:
        raise GclError(f'{pairs.name}: {options.data} has no such pair')
    write_pair_list(options.list, pairs)
    print(f'wrote {pairs.label} to {options.list}')
    return 0


def _draw(options: argparse.Namespace, sequences: dict[str, Sequence]) -> PairList:
    if options.range:
        return pair_sets.distance_set(sequences, *options.range)
    if options.fcgf:
        return pair_sets.fcgf_set(sequences)
    if options.random is not None:
        return pair_sets.random_set(sequences, per_bin=options.random, seed=options.seed)
    with tqdm(unit='pair') as bar:
        return pair_sets.low_overlap_set(sequences, keep=lambda pair, share: bar.update() and None)
