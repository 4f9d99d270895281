"""Equation 2, and what the range to one sensor tells of the range to another."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from gcl_core.evaluation.figures.sampling import Ranges

REACH, CELL = 80.0, 5.0  # metres: farthest range counted, edge of a cell when counting


def roadside(b: float, h: float, steps: int = 801) -> Ranges:
    """Ranges from two sensors to points along a roadside line: the curve of equation 2.

    Args:
        b: distance between the sensors, metres.
        h: distance of the line from the line through both sensors, metres.
        steps: points on the curve.
    """
    along = np.linspace(-REACH, REACH + b, steps)
    return np.stack([np.hypot(along, h), np.hypot(along - b, h)], axis=1)


def near_curve(ranges: Ranges, b: float, h: float, within: float) -> float:
    """Share of one or more positives that lie `within` metres of equation 2's curve."""
    away, _ = cKDTree(roadside(b, h)).query(ranges)
    return float(np.mean(away <= within))


def shared_bits(ranges: Ranges, rng: np.random.Generator) -> float:
    """Mutual information of the two ranges in cells of 5 m, bits; about 0 if independent.

    The same of shuffled ranges is taken off: what chance gives to so many points.
    """
    shuffled = np.stack([ranges[:, 0], rng.permutation(ranges[:, 1])], axis=1)
    return _information(histogram(ranges)) - _information(histogram(shuffled))


def histogram(ranges: Ranges) -> Float[np.ndarray, 'k k']:
    """Share of positives in each cell."""
    edges = np.arange(0, REACH + CELL, CELL)
    counts = np.histogram2d(ranges[:, 0], ranges[:, 1], bins=(edges, edges))[0]
    return np.asarray(counts / max(counts.sum(), 1))


def total_variation(p: np.ndarray, q: np.ndarray) -> float:
    """Share of one distribution that would have to move to make the other, in [0, 1]."""
    return float(abs(p - q).sum() / 2)


def _information(joint: Float[np.ndarray, 'k k']) -> float:
    independent = joint.sum(1, keepdims=True) * joint.sum(0, keepdims=True)
    some = joint > 0
    return float((joint[some] * np.log2(joint[some] / independent[some])).sum())
