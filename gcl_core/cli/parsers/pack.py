"""`gcl pack`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.form import add_json, add_layout, form


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'pack',
        help='write scans a hundredth as large',
        **form(
            'Write a scan as its occupied voxels (.gcl), or every scan of a folder or of a KITTI\n'
            'sequence into a folder, with its poses. Every command that reads clouds reads them.',
            [
                'gcl pack scan.bin scan.gcl',
                'gcl pack KITTI_DIR packed_08 --sequence 08',
                'gcl pack CLOUDS_DIR packed --voxel-size 0.1 --residual-bits 2',
            ],
        ),
    )
    parser.add_argument('scans', type=Path, help='a cloud, a folder of clouds, or KITTI')
    parser.add_argument('out', type=Path, help='file .gcl, or folder, to write')
    parser.add_argument('--sequence', help='KITTI digits; default: the only one')
    add_compact(parser)
    add_layout(parser)
    add_json(parser)


def add_compact(parser: argparse.ArgumentParser) -> None:
    """Add how much of a scan is kept."""
    parser.add_argument(
        '--voxel-size', type=float, default=0.25, metavar='M', help='default: %(default)g m'
    )
    parser.add_argument(
        '--max-range',
        type=float,
        default=100.0,
        metavar='M',
        help='farther points are left out; default: %(default)g m',
    )
    parser.add_argument(
        '--residual-bits',
        type=int,
        default=0,
        metavar='N',
        help='bits an axis for the place in the voxel; default: %(default)d, its centre',
    )
