"""What the commands share: options that name sequences, and how they are opened."""

from __future__ import annotations

import argparse
from pathlib import Path

from gcl_core.data.formats import LAYOUTS, open_sequence
from gcl_core.data.sequence import Sequence


def add_layout(parser: argparse.ArgumentParser) -> None:
    """Add `--format`."""
    parser.add_argument(
        '--format', choices=sorted(LAYOUTS), help='layout of the data; seen from the folder if not'
    )


def open_all(path: Path, names: list[str] | None, layout: str | None) -> dict[str, Sequence]:
    """Open sequences by the short names that a pair list gives them.

    Without names there must be one; its own name is then the part after the slash, such as
    `my_drive` of `folder/my_drive`.
    """
    if names:
        return {name: open_sequence(path, name, layout=layout) for name in names}
    sequence = open_sequence(path, layout=layout)
    return {sequence.name.split('/', 1)[1]: sequence}
