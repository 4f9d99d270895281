"""Register every pair once and keep what came out; scoring reads only the file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.pairs import Pair, T_target_source
from gcl_core.data.sequence import Sequence
from gcl_core.types import PointCloud

Method = Callable[[PointCloud, PointCloud], Float[np.ndarray, '4 4'] | None]


@dataclass(frozen=True)
class Prediction:
    """One method on one pair.

    Attributes:
        method: name of the method.
        sequence: name of the sequence.
        pair: scans and distance.
        turned: heading that the source was turned by, radians.
        T_true: true `T_target_source` of the turned source.
        T_estimated: None where nothing was found.
        seconds: time taken.
    """

    method: str
    sequence: str
    pair: Pair
    turned: float
    T_true: Float[np.ndarray, '4 4']
    T_estimated: Float[np.ndarray, '4 4'] | None
    seconds: float


@dataclass(frozen=True)
class TurnedPair:
    """The scans of a pair, the source turned by a heading.

    Attributes:
        pair: which scans.
        turned: heading that the source was turned by, radians.
        source: as turned.
        target: as recorded.
        T_true: maps the turned source into the target frame.
    """

    pair: Pair
    turned: float
    source: PointCloud
    target: PointCloud
    T_true: Float[np.ndarray, '4 4']


def turned_pairs(
    sequence: Sequence, pairs: Iterable[Pair], random_yaw_seed: int | None
) -> Iterator[TurnedPair]:
    """Read each pair, its source turned by a random heading if there is a seed for it."""
    rng = None if random_yaw_seed is None else np.random.default_rng(random_yaw_seed)
    for pair in pairs:
        turned = 0.0 if rng is None else float(rng.uniform(-np.pi, np.pi))
        T_turned_source = se3.from_xyz_rpy(yaw=turned)
        target = sequence.scan(pair.target)
        source = PointCloud(se3.transform(T_turned_source, sequence.scan(pair.source).points))
        T_true = T_target_source(sequence, pair) @ se3.inverse(T_turned_source)
        yield TurnedPair(pair, turned, source, target, T_true)


def predict(
    methods: dict[str, Method],
    sequence: Sequence,
    pairs: Iterable[Pair],
    *,
    random_yaw_seed: int | None = None,
) -> Iterator[Prediction]:
    """Run every method on every pair, one after the other on the same scans.

    Args:
        methods: by name; each maps (source, target) to a transform or None.
        sequence: source of the scans.
        pairs: scans to register.
        random_yaw_seed: turn each source by a random heading first.
    """
    for p in turned_pairs(sequence, pairs, random_yaw_seed):
        for name, method in methods.items():
            began = time.perf_counter()
            T = method(p.source, p.target)
            seconds = time.perf_counter() - began
            yield Prediction(name, sequence.name, p.pair, p.turned, p.T_true, T, seconds)
