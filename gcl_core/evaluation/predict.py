"""What one method makes of one pair: the pair as it is given, the answer, its time and memory."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.pairs import Pair
from gcl_core.data.sequence import Sequence, T_target_source
from gcl_core.types import PointCloud

Method = Callable[[PointCloud, PointCloud], Float[np.ndarray, '4 4'] | None]


@dataclass(frozen=True)
class Outcome:
    """The answer of a method.

    Attributes:
        method: its name in results.
        T_target_source: None where nothing was found, or what was found was withheld.
        seconds: time taken.
        ms: of its stages, milliseconds, where it tells them.
    """

    method: str
    T_target_source: Float[np.ndarray, '4 4'] | None
    seconds: float
    ms: dict[str, float] = field(default_factory=dict)


Contestant = Callable[[PointCloud, PointCloud], Iterator[Outcome]]  # one or more methods


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
        dataset: set of pairs that it belongs to.
        task: number of the pair in its run.
        ms: of the method's stages, milliseconds.
        peak_mb: growth of the process's memory, MB; nan where it was not measured.
        overlap: share of the source's voxels that the target sees; nan where it is not known.
        sensors: of source and target, such as `hdl32e to hdl64e`; empty where not known.
    """

    method: str
    sequence: str
    pair: Pair
    turned: float
    T_true: Float[np.ndarray, '4 4']
    T_estimated: Float[np.ndarray, '4 4'] | None
    seconds: float
    dataset: str = ''
    task: int = 0
    ms: dict[str, float] = field(default_factory=dict)
    peak_mb: float = np.nan
    overlap: float = np.nan
    sensors: str = ''


@dataclass(frozen=True)
class TurnedPair:
    """The scans of a pair, the source turned by a heading.

    Attributes:
        source: as turned.
        target: as recorded.
        T_true: maps the turned source into the target frame.
    """

    source: PointCloud
    target: PointCloud
    T_true: Float[np.ndarray, '4 4']


def turned_pair(sequence: Sequence, pair: Pair, turned: float) -> TurnedPair:
    """Read a pair and turn its source by a heading, radians."""
    T_turned_source = se3.from_xyz_rpy(yaw=turned)
    source = PointCloud(se3.transform(T_turned_source, sequence.scan(pair.source).points))
    T = T_target_source(sequence, source=pair.source, target=pair.target)
    T_true = T @ se3.inverse(T_turned_source)
    return TurnedPair(source, sequence.scan(pair.target), T_true)


def timed(name: str, method: Method, source: PointCloud, target: PointCloud) -> Outcome:
    """Run a method on two scans."""
    began = time.perf_counter()
    T = method(source, target)
    return Outcome(name, T, time.perf_counter() - began)
