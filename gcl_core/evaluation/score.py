"""Predictions to recall by distance, with intervals, as rows and as a Markdown table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcl_core.evaluation import metrics
from gcl_core.evaluation.predict import Prediction


@dataclass(frozen=True)
class Row:
    """One method in one distance bin.

    Attributes:
        strict: pairs registered within 0.6 m and 1.5 degrees.
        loose: pairs registered within 2 m and 5 degrees.
        found: pairs for which a transform was given.
        wrong: transforms given that miss the loose criterion.
        rte: mean over loosely registered pairs, metres; nan without any.
        rre_deg: likewise, degrees.
        seconds: median time of a pair; through the node, of those that were answered.
    """

    method: str
    bin: tuple[int, int]
    pairs: int
    strict: int
    loose: int
    found: int
    wrong: int
    rte: float
    rre_deg: float
    seconds: float


def score(predictions: Sequence[Prediction]) -> list[Row]:
    """Group predictions by method and bin, in order of appearance."""
    groups: dict[tuple[str, tuple[int, int]], list[Prediction]] = {}
    for p in predictions:
        groups.setdefault((p.method, p.pair.bin), []).append(p)
    return [_row(method, bin_, items) for (method, bin_), items in groups.items()]


def _row(method: str, bin_: tuple[int, int], items: list[Prediction]) -> Row:
    def count(criterion: metrics.Criterion) -> int:
        return sum(metrics.registered(p.T_estimated, p.T_true, criterion) for p in items)

    good = [
        (metrics.rte(p.T_estimated, p.T_true), metrics.rre_deg(p.T_estimated, p.T_true))
        for p in items
        if p.T_estimated is not None and metrics.registered(p.T_estimated, p.T_true, metrics.LOOSE)
    ]
    rte, rre_deg = np.mean(good, axis=0) if good else (np.nan, np.nan)
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
    )


def markdown(rows: Sequence[Row]) -> str:
    """Format rows; recalls in percent with their 95 % Wilson interval."""

    def share(successes: int, trials: int) -> str:
        low, high = metrics.wilson(successes, trials)
        return f'{100 * successes / trials:.0f} ({100 * low:.0f}–{100 * high:.0f})'

    lines = [
        '| method | distance, m | pairs | strict, % | loose, % | wrong | RTE, m | RRE, ° | s |',
        '|---|---|---|---|---|---|---|---|---|',
    ]
    for r in rows:
        lines.append(
            f'| {r.method} | {r.bin[0]}–{r.bin[1]} | {r.pairs} | {share(r.strict, r.pairs)} | '
            f'{share(r.loose, r.pairs)} | {r.wrong} | {r.rte:.2f} | {r.rre_deg:.2f} | '
            f'{r.seconds:.2g} |'
        )
    return '\n'.join(lines)
