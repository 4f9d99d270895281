"""`gcl simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.choices import KINDS, MANOEUVRES, SENSORS, STORAGES
from gcl_core.cli.parsers.form import form
from gcl_core.cli.parsers.quantities import count, positive, seed


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'simulate',
        help='write simulated drives',
        **form(
            'Write one vehicle, or two that meet, in KITTI layout (sequences 00 and 01) or, two\n'
            'only, as a bag with the true transforms.',
            [
                'gcl simulate 7 drive --scans 20',
                'gcl simulate 7 meeting --meet oncoming --sensor hdl64e hdl32e --scans 20 --bag',
            ],
        ),
    )
    parser.add_argument('world', type=seed, help='seed of the world')
    parser.add_argument('out', type=Path, help='folder to write')
    parser.add_argument('--kind', choices=KINDS, help='kind of place; default: by the seed')
    parser.add_argument('--meet', choices=MANOEUVRES, help='a second vehicle that does so')
    parser.add_argument(
        '--sensor',
        nargs='+',
        default=['hdl64e'],
        choices=SENSORS,
        help='of the first and, if it has another, of the second vehicle; default: hdl64e',
    )
    parser.add_argument(
        '--spacing', type=positive, default=1.0, help='metres between scans; default: %(default)g'
    )
    parser.add_argument(
        '--scans', type=count, help='scans from the middle of the drive; default: all'
    )
    parser.add_argument('--bag', action='store_true', help='write a rosbag2 instead')
    parser.add_argument(
        '--storage', choices=STORAGES, default='mcap', help='of the bag; default: %(default)s'
    )
