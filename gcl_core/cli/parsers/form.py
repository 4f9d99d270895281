"""One form of help for every command, and options that several of them share."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from gcl_core.cli.parsers.choices import LAYOUTS
from gcl_core.cli.parsers.quantities import seed

EXIT_CODES = (
    'exit codes:\n  0 done, 1 no transform accepted, 2 bad input, 130 stopped by Ctrl-C,\n'
    '  141 nobody reads the output any more'
)


def form(description: str, examples: Sequence[str]) -> dict[str, Any]:
    """Arguments of a parser: what it is for, lines to paste, exit codes."""
    lines = '\n'.join(f'  {line}' for line in examples)
    title = 'example' if len(examples) == 1 else 'examples'
    return {
        'description': description,
        'epilog': f'{title}:\n{lines}\n\n{EXIT_CODES}' if lines else EXIT_CODES,
        'formatter_class': argparse.RawDescriptionHelpFormatter,
    }


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add `--json`."""
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def add_source(
    parser: argparse.ArgumentParser, *, required: bool = True, several: bool = False
) -> None:
    """Add `--data` or `--simulated`, `--sequence` (a list of several), and how they are read."""
    source = parser.add_mutually_exclusive_group(required=required)
    source.add_argument('--data', type=Path, help='data set, bag, or folder of clouds')
    source.add_argument('--simulated', type=seed, metavar='SEED', help='a simulated drive')
    parser.add_argument(
        '--sequence',
        nargs='+' if several else None,
        help='KITTI digits, nuScenes log, …; default: the only one',
    )
    add_layout(parser)


def add_layout(parser: argparse.ArgumentParser) -> None:
    """Add `--format` and `--columns`."""
    parser.add_argument(
        '--format', choices=LAYOUTS, help='layout of the data; default: seen from the folder'
    )
    add_columns(parser)


def add_columns(parser: argparse.ArgumentParser) -> None:
    """Add `--columns`."""
    parser.add_argument(
        '--columns',
        metavar='N',
        help='of a .bin, such as 5, or 4xfloat64; default: seen from its numbers',
    )


def parsed(
    parser: argparse.ArgumentParser, arguments: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse, after an answer to the shell's completion where it asks and argcomplete is there."""
    if '_ARGCOMPLETE' in os.environ:
        with suppress(ImportError):
            import argcomplete

            argcomplete.autocomplete(parser)
    return parser.parse_args(arguments)
