"""Scores as tables: one form for Markdown, the page and the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcl_core.evaluation import metrics
from gcl_core.evaluation.predict import Prediction
from gcl_core.evaluation.score import Group, Row, mean_recall, rank


@dataclass(frozen=True)
class Table:
    """Text in rows.

    Attributes:
        title: empty where it stands alone.
        head: of the columns.
        rows: cells.
        note: below it.
    """

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str = ''

    def markdown(self) -> str:
        """The table alone, without title and note."""
        lines = [f'| {" | ".join(cells)} |' for cells in (self.head, *self.rows)]
        return '\n'.join([lines[0], '|' + '---|' * len(self.head), *lines[1:]])


def label(group: Group) -> str:
    """A group of pairs as tables name it."""
    return group if isinstance(group, str) else f'{group[0]:g}–{group[1]:g}'


def share(successes: int, trials: int) -> str:
    """A recall in percent with its 95 % Wilson interval."""
    low, high = metrics.wilson(successes, trials)
    return f'{100 * successes / trials:.0f} ({100 * low:.0f}–{100 * high:.0f})'


def named(criterion: metrics.Criterion) -> str:
    """A criterion in words."""
    return f'{criterion.rte:g} m, {criterion.rre_deg:g}°'


def number(value: float, form: str) -> str:
    """A number, or a dash where there is none."""
    return format(value, form) if np.isfinite(value) else '–'


def recall(
    rows: Sequence[Row],
    what: str = 'distance, m',
    *,
    title: str = '',
    criteria: Sequence[metrics.Criterion] = (),
) -> Table:
    """Recall, errors, time and memory of every row; the set only where there are several."""
    several = len({row.dataset for row in rows}) > 1
    weighed = any(np.isfinite(row.peak_mb) for row in rows)
    head = ('pairs of',) * several + ('method', what, 'pairs', 'strict, %', 'loose, %')
    head += (*(f'{named(c)}, %' for c in criteria), 'wrong', 'RTE, m', 'RRE, °', 's')
    cells = [
        (row.dataset,) * several
        + (row.method, label(row.bin), str(row.pairs))
        + tuple(share(n, row.pairs) for n in (row.strict, row.loose, *row.more))
        + (str(row.wrong), number(row.rte, '.2f'), number(row.rre_deg, '.2f'))
        + (number(row.seconds, '.2g'),)
        + (number(row.peak_mb, '.0f'),) * weighed
        for row in rows
    ]
    return Table(title, head + ('MB',) * weighed, cells)


def across(rows: Sequence[Row]) -> Table:
    """Strict recall of every method, a column for each group of pairs."""
    groups = sorted({row.bin for row in rows}, key=rank)
    own = {(row.dataset, row.method, row.bin): share(row.strict, row.pairs) for row in rows}
    cells = [
        (*who, *(own.get((*who, group), '–') for group in groups))
        for who in dict.fromkeys((row.dataset, row.method) for row in rows)
    ]
    return Table('', ('pairs of', 'method', *map(label, groups)), cells)


def markdown(rows: Sequence[Row]) -> str:
    """Format rows by distance."""
    return recall(rows).markdown()


def summary(rows: Sequence[Row]) -> Table:
    """All pairs of a set in one row: recall over pairs, and mRR, the mean over the bins."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.dataset, row.method), []).append(row)
    cells = []
    for (dataset, method), own in groups.items():
        pairs = sum(row.pairs for row in own)
        cells.append(
            (dataset, method, str(pairs), str(len(own)))
            + tuple(share(sum(n), pairs) for n in zip(*((r.strict, r.loose) for r in own)))
            + (f'{100 * mean_recall(own, lambda r: r.strict):.1f}',)
            + (f'{100 * mean_recall(own, lambda r: r.loose):.1f}', str(sum(r.wrong for r in own)))
        )
    names = 'pairs of', 'method', 'pairs', 'bins', 'strict, %', 'loose, %'
    head = (*names, 'mRR strict', 'mRR loose', 'wrong')
    note = 'mRR: mean over the bins that have pairs; compare it only where the bins are the same.'
    return Table('All distances', head, cells, note)


def stages(predictions: Sequence[Prediction]) -> Table | None:
    """Median time of every stage, of the methods that tell them."""
    own: dict[str, list[Prediction]] = {}
    timed = set()  # two answers of one registration took its time once
    for p in predictions:
        moment = (p.task, p.seconds)
        if p.ms and moment not in timed:
            timed.add(moment)
            own.setdefault(p.method, []).append(p)
    if not own:
        return None
    names = list(dict.fromkeys(key for items in own.values() for p in items for key in p.ms))
    cells = [
        (method, str(len(items)))
        + tuple(f'{np.median([p.ms.get(name, 0.0) for p in items]):.1f}' for name in names)
        for method, items in own.items()
    ]
    note = 'Median milliseconds a pair; data: voxels, neighbours and surfaces of all headings.'
    return Table('Time of the stages', ('method', 'pairs', *names), cells, note)
