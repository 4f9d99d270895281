"""Pairs of scans of one drive, by the distance between their sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int
from scipy.spatial import cKDTree

from gcl_core.data.sequence import Sequence, positions

BINS = ((5, 10), (10, 20), (20, 30), (30, 40), (40, 50))  # metres; the paper's five sets


@dataclass(frozen=True)
class Pair:
    """Two scans of a sequence.

    Attributes:
        source: scan index.
        target: scan index.
        distance: between the two sensors, metres.
        bin: the set that the distance falls into, metres.
    """

    source: int
    target: int
    distance: float
    bin: tuple[int, int]


def draw_pairs(
    sequence: Sequence,
    *,
    per_bin: int,
    seed: int = 0,
    drives: Int[np.ndarray, ' n'] | None = None,
    bins: tuple[tuple[int, int], ...] = BINS,
) -> list[Pair]:
    """Draw up to `per_bin` random pairs for each bin; the earlier scan is the target.

    Not the paper's protocol for KITTI [b1, b2], which needs a whole drive; short sequences use it.
    Pairs of one drive are correlated, so that intervals on them are too narrow.

    Args:
        sequence: to draw from.
        per_bin: most pairs of a bin.
        seed: of the draw.
        drives: drive of each scan; only pairs of scans of two drives are drawn.
        bins: of distance, metres, the farthest last.
    """
    where = positions(sequence)
    near = cKDTree(where).query_pairs(bins[-1][1], output_type='ndarray')
    if drives is not None:
        near = near[drives[near[:, 0]] != drives[near[:, 1]]]
    target, source = near[np.lexsort((near[:, 1], near[:, 0]))].T
    distance = np.linalg.norm(where[source] - where[target], axis=1)
    rng = np.random.default_rng(seed)
    pairs = []
    for low, high in bins:
        inside = np.flatnonzero((distance >= low) & (distance < high))
        for row in inside[np.sort(rng.permutation(len(inside))[:per_bin])]:
            apart = float(distance[row])
            pairs.append(Pair(int(source[row]), int(target[row]), apart, (low, high)))
    return pairs
