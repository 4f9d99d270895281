"""`gcl train`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.form import form
from gcl_core.cli.parsers.quantities import positive


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        'train',
        help='train an extractor',
        **form(
            'Train on simulated streets, or on the drives of samples.data. Run again with the\n'
            'same folder to resume.',
            ['gcl train --config config/train_conv.yaml --out runs/conv --set steps=100'],
        ),
    )
    parser.add_argument('--config', type=Path, required=True, help='YAML of TrainConfig')
    parser.add_argument(
        '--set',
        nargs='+',
        default=[],
        metavar='KEY=VALUE',
        help='instead of what the YAML says: --set loss.pair=1 samples.phi=4',
    )
    parser.add_argument('--out', type=Path, required=True, help='checkpoint, log, curves, weights')
    parser.add_argument('--cache', type=Path, help='keep cut samples here, to use them again')
    parser.add_argument(
        '--cache-gb',
        type=positive,
        default=10.0,
        help='largest size of the cache, GB; default: %(default)g',
    )
