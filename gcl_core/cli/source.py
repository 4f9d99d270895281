"""The options that several commands share."""

from __future__ import annotations

import argparse
from pathlib import Path

from gcl_core.data.formats import LAYOUTS


def add_source(
    parser: argparse.ArgumentParser, *, required: bool = True, several: bool = False
) -> None:
    """Add `--data` or `--simulated`, `--sequence` (a list of several) and `--format`."""
    source = parser.add_mutually_exclusive_group(required=required)
    source.add_argument('--data', type=Path, help='data set, bag, or folder of clouds')
    source.add_argument('--simulated', type=int, metavar='SEED', help='a simulated drive')
    parser.add_argument(
        '--sequence',
        nargs='+' if several else None,
        help='KITTI digits, nuScenes log, …; default: the only one',
    )
    add_layout(parser)


def add_layout(parser: argparse.ArgumentParser) -> None:
    """Add `--format`."""
    parser.add_argument(
        '--format', choices=sorted(LAYOUTS), help='layout of the data; seen from the folder if not'
    )
