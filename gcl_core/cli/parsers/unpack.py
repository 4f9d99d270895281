"""`gcl unpack`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.form import form


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'unpack',
        help='write a packed scan as points that other programs read',
        **form(
            'Write the points of a packed scan, one for each voxel.',
            ['gcl unpack scan.gcl scan.pcd'],
        ),
    )
    parser.add_argument('scan', type=Path, help='.gcl')
    parser.add_argument('out', type=Path, help='.pcd, .ply, .npy or .bin to write')
