"""Count the priors of compact scans on simulated ones: python -m gcl_core.training.compact_priors.

A new table is a new version of the format: raise `VERSION` in compact/scan.py with it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Int64, UInt8

from gcl_core.compact import octree, scan
from gcl_core.compact.priors import FILE, STEP, stored
from gcl_core.data.simulator.sensors import SENSORS
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.files import whole_file
from gcl_core.progress import progress

WORLDS = range(980_000_000, 980_000_008)  # seeds that neither training nor tests use
VOXEL_SIZES = (0.25, 0.12)
BELIEF = 4.0  # decisions that the estimate of a more general context counts as
FIELDS = (4, 128, 8, 8, 8)  # level class, cells before, nodes behind, child, more cells


class Tally(list[int]):
    """Stands in for coder and probabilities: counts the decisions in each context.

    Attributes:
        seen: decisions in each context, and those for an occupied cell.
    """

    def __init__(self) -> None:
        super().__init__([1 << 15] * octree.CONTEXTS)
        self.seen = np.zeros((octree.CONTEXTS, 2), np.int64)
        self._bit = 0

    def code(self, bit: int, _: int) -> int:
        """Remember a decision."""
        self._bit = bit
        return bit

    def __setitem__(self, context: Any, _: Any) -> None:
        """Count it for its context."""
        self.seen[context] += 1, self._bit


def count() -> Int64[np.ndarray, 'contexts 2']:
    """Count the decisions of a scan of each sensor in each world, see `Tally.seen`."""
    tally = Tally()
    drives = [(seed, sensor) for seed in WORLDS for sensor in SENSORS]
    for number, (seed, sensor) in enumerate(progress(drives, unit='scan')):
        drive = SimulatedSequence(seed, sensor=sensor)
        config = scan.CompactConfig(voxel_size=VOXEL_SIZES[number % len(VOXEL_SIZES)])
        keys, depth, *_ = scan.occupied(drive.scan(len(drive) // 2), config)
        for level, children in enumerate(octree.levels_of(keys, depth)):
            octree.code_level(tally, children, depth - 1 - level, tally)
    return tally.seen


def smoothed(seen: Int64[np.ndarray, 'contexts 2']) -> UInt8[np.ndarray, ' contexts']:
    """Probabilities in steps of 1/256; where little was seen, those of more general contexts."""
    by_field = seen.reshape(*FIELDS, 2).astype(float)
    probability = np.full(FIELDS, by_field[..., 1].sum() / by_field[..., 0].sum())
    for general in ((0, 2, 4), (2, 4), (4,), ()):  # fields that are left out, ever fewer
        total, occupied = (by_field[..., i].sum(general, keepdims=True) for i in (0, 1))
        probability = (occupied + BELIEF * probability) / (total + BELIEF)
    return np.clip(np.rint(probability * STEP), 1, STEP - 1).astype(np.uint8).flatten()


if __name__ == '__main__':
    with whole_file(FILE) as part:
        part.write_bytes(stored(smoothed(count())))
