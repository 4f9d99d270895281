"""Probabilities that the octree coder begins with.

They are part of the format: a scan is read with the priors that it was written with.
`python -m gcl_core.training.compact_priors` counts them on simulated scans.
"""

from __future__ import annotations

import lzma
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import UInt8, UInt16

FILE = Path(__file__).with_name('priors.xz')
STEP = 256  # a prior is stored as a byte, in steps of 1/256


@cache
def priors() -> UInt16[np.ndarray, ' contexts']:
    """Read the table: the probability of an occupied cell in each context, of 65,536."""
    stored = np.frombuffer(lzma.decompress(FILE.read_bytes()), np.uint8)
    return stored.astype(np.uint16) * STEP


def stored(probability: UInt8[np.ndarray, ' contexts']) -> bytes:
    """The content of the file that holds a table in steps of 1/256."""
    return lzma.compress(probability.tobytes(), preset=9 | lzma.PRESET_EXTREME)
