"""Predictions to recall, with intervals, by distance or whatever else pairs have in common."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.evaluation.predict import Prediction

Group = tuple[float, float] | str  # from, to; or a name
YAWS = (0, 15, 45, 90, 135, 180)  # degrees
OVERLAPS = (0, 10, 20, 30, 50, 70, 100)  # percent; the low-overlap sets end at 30


@dataclass(frozen=True)
class Row:
    """One method on one group of pairs.

    Attributes:
        dataset: set that the pairs belong to.
        bin: what they have in common: distance in metres, unless scored by something else.
        strict: pairs registered within 0.6 m and 1.5 degrees.
        loose: pairs registered within 2 m and 5 degrees.
        found: pairs for which a transform was given.
        wrong: transforms given that miss the loose criterion.
        rte: mean over loosely registered pairs, metres; nan without any.
        rre_deg: likewise, degrees.
        seconds: median time of a pair; through the node, of those that were answered.
        rte_median: over loosely registered pairs, metres.
        rre_median_deg: likewise, degrees.
        peak_mb: largest growth of memory that was measured; nan where none was.
        more: pairs registered by further criteria, in their order.
    """

    method: str
    bin: Group
    pairs: int
    strict: int
    loose: int
    found: int
    wrong: int
    rte: float
    rre_deg: float
    seconds: float
    dataset: str = ''
    rte_median: float = np.nan
    rre_median_deg: float = np.nan
    peak_mb: float = np.nan
    more: tuple[int, ...] = ()


def by_distance(prediction: Prediction) -> Group:
    """The pair's bin, metres."""
    return prediction.pair.bin


def by_yaw(prediction: Prediction) -> Group:
    """Difference in heading, degrees."""
    return _between(abs(np.rad2deg(se3.yaw(prediction.T_true))), YAWS)


def by_overlap(prediction: Prediction) -> Group:
    """Share of the source that the target sees, percent; empty where it is not known."""
    if not np.isfinite(prediction.overlap):
        return ''
    return _between(100 * prediction.overlap, OVERLAPS)


def by_sensors(prediction: Prediction) -> Group:
    """Sensors of source and target; empty where they are not known."""
    return prediction.sensors


def together(prediction: Prediction) -> Group:
    """All pairs in one group."""
    return 'all'


def _between(value: float, edges: Sequence[float]) -> Group:
    place = int(np.clip(np.searchsorted(edges, value, side='right'), 1, len(edges) - 1))
    return (edges[place - 1], edges[place])


def score(
    predictions: Sequence[Prediction],
    by: Callable[[Prediction], Group] = by_distance,
    criteria: Sequence[metrics.Criterion] = (),
) -> list[Row]:
    """Group predictions by set, method and what `by` tells; the known groups alone, in order.

    Sets and methods come in order of appearance, groups of numbers from low to high.
    """
    groups: dict[tuple[str, str, Group], list[Prediction]] = {}
    for p in predictions:
        groups.setdefault((p.dataset, p.method, by(p)), []).append(p)
    rows = [_row(*key, items, criteria) for key, items in groups.items() if key[2] != '']
    places = {(r.dataset, r.method): i for i, r in reversed(list(enumerate(rows)))}
    return sorted(rows, key=lambda r: (places[r.dataset, r.method], *rank(r.bin)))


def rank(group: Group) -> tuple[float, float, str]:
    """Place of a group among others: numbers from low to high, then names."""
    return (np.inf, np.inf, group) if isinstance(group, str) else (*group, '')


def _row(
    dataset: str,
    method: str,
    bin_: Group,
    items: list[Prediction],
    criteria: Sequence[metrics.Criterion],
) -> Row:
    def count(criterion: metrics.Criterion) -> int:
        return sum(metrics.registered(p.T_estimated, p.T_true, criterion) for p in items)

    good = [
        (metrics.rte(p.T_estimated, p.T_true), metrics.rre_deg(p.T_estimated, p.T_true))
        for p in items
        if p.T_estimated is not None and metrics.registered(p.T_estimated, p.T_true, metrics.LOOSE)
    ]
    rte, rre_deg = np.mean(good, axis=0) if good else (np.nan, np.nan)
    medians = np.median(good, axis=0) if good else (np.nan, np.nan)
    times = [p.seconds for p in items if np.isfinite(p.seconds)]
    found = sum(p.T_estimated is not None for p in items)
    return Row(
        method=method,
        bin=bin_,
        pairs=len(items),
        strict=count(metrics.STRICT),
        loose=len(good),
        found=found,
        wrong=found - len(good),
        rte=float(rte),
        rre_deg=float(rre_deg),
        seconds=float(np.median(times)) if times else np.nan,
        dataset=dataset,
        rte_median=float(medians[0]),
        rre_median_deg=float(medians[1]),
        peak_mb=max((p.peak_mb for p in items if np.isfinite(p.peak_mb)), default=np.nan),
        more=tuple(count(criterion) for criterion in criteria),
    )


def mean_recall(rows: Sequence[Row], count: Callable[[Row], int]) -> float:
    """mRR: mean over the bins of one method on one set (paper, "Metrics"); in [0, 1]."""
    return float(np.mean([count(row) / row.pairs for row in rows]))
