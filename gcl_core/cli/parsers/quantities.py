"""Numbers of the command line, refused where they make no sense."""

from __future__ import annotations

import argparse
import math


def seed(text: str) -> int:
    """A whole number from 0 to 2^63 - 1, as generators take it."""
    return _whole(text, 0)


def count(text: str) -> int:
    """A whole number of at least 1."""
    return _whole(text, 1)


def _whole(text: str, least: int) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if not least <= value < 2**63:
        raise argparse.ArgumentTypeError(f'{text!r} is no whole number of at least {least}')
    return value


def positive(text: str) -> float:
    """A finite number above 0."""
    value = _number(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text!r} is no number above 0')
    return value


def not_negative(text: str) -> float:
    """A finite number of at least 0."""
    value = _number(text)
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'{text!r} is no number of at least 0')
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
