"""`gcl register`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.form import add_columns, add_json, form

SCAN = 'drive/sequences/{}/velodyne/000010.bin'


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'register',
        help='register two scans',
        **form(
            'Print the transform that maps SOURCE points into the frame of TARGET.',
            [
                'gcl simulate 7 drive --meet oncoming --scans 20',
                f'gcl register {SCAN.format("01")} {SCAN.format("00")} --picture pair.png',
            ],
        ),
    )
    parser.add_argument('source', type=Path, help='.bin (KITTI), .pcd, .ply, .npy or .gcl')
    parser.add_argument('target', type=Path, help='likewise')
    parser.add_argument('--config', type=Path, help='YAML of RegistrarConfig')
    parser.add_argument('--aligned', type=Path, help='write the source in the target frame here')
    parser.add_argument('--picture', type=Path, help="write a bird's-eye picture (.png) here")
    parser.add_argument('--rerun', type=Path, help='write a Rerun recording (.rrd) here')
    add_columns(parser)
    add_json(parser)
