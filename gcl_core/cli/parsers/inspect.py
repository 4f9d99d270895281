"""`gcl inspect`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.choices import KINDS, SENSORS
from gcl_core.cli.parsers.form import add_json, add_source, form
from gcl_core.cli.parsers.quantities import count


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'inspect',
        help='show what is in a sequence, a pair or a group',
        **form(
            'Count points and voxels of 0.3 m by range, overlap of a pair, groups.',
            [
                'gcl inspect --simulated 7 --pair 120 100 --picture pair.png',
                'gcl inspect --data KITTI_DIR --sequence 08 --compare 4 --picture both.png',
            ],
        ),
    )
    add_source(parser)
    parser.add_argument(
        '--sensor', default='hdl64e', choices=SENSORS, help='simulated; default: %(default)s'
    )
    parser.add_argument('--kind', choices=KINDS, help='of simulated place; default: by the seed')
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--scan', type=int, metavar='I', help='one scan')
    what.add_argument('--pair', type=int, nargs=2, metavar=('SOURCE', 'TARGET'), help='two scans')
    what.add_argument('--group', type=int, metavar='CENTRE', help='a centre and its neighbours')
    what.add_argument(
        '--compare',
        type=count,
        metavar='WORLDS',
        help='beside scans of this many simulated worlds',
    )
    parser.add_argument(
        '--scans', type=count, default=8, help='to count in a sequence; default: %(default)s'
    )
    parser.add_argument(
        '--hide-scan', action='store_true', help='no scan of the sequence itself in --compare'
    )
    parser.add_argument('--picture', type=Path, help='write a picture here')
    add_json(parser)
