"""`gcl pairs`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.form import add_json, add_layout, form
from gcl_core.cli.parsers.quantities import count, seed


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'pairs',
        help='write a list of scan pairs',
        **form(
            'Draw pairs as the benchmarks do; results name the list and its hash.',
            [
                'gcl simulate 7 drive',
                'gcl pairs pairs.txt --data drive --sequence 00 --random 2',
                'gcl pairs kitti.txt --data KITTI_DIR --sequence 08 09 10 --range 20 30',
            ],
        ),
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
    kind.add_argument('--random', type=count, metavar='N', help='N random pairs in each bin')
    parser.add_argument('--seed', type=seed, default=0, help='of --random; default: %(default)s')
    add_json(parser)
