"""The option that several commands share."""

from __future__ import annotations

import argparse

from gcl_core.data.formats import LAYOUTS


def add_layout(parser: argparse.ArgumentParser) -> None:
    """Add `--format`."""
    parser.add_argument(
        '--format', choices=sorted(LAYOUTS), help='layout of the data; seen from the folder if not'
    )
