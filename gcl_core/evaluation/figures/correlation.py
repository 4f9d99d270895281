"""How far two sensors are from the spots that both see: pairs bend into a U, groups spread.

Paper, section "Analysis": equation 2, figures "Our hypothesis" and "Visual validation".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gcl_core.data.sequence import Sequence
from gcl_core.evaluation.figures import result
from gcl_core.evaluation.figures.dependence import (
    histogram,
    near_curve,
    roadside,
    shared_bits,
    total_variation,
)
from gcl_core.evaluation.figures.result import FigureResult, Row
from gcl_core.evaluation.figures.sampling import (
    KINDS,
    Positives,
    Ranges,
    draw_positives,
    two_members,
)

BATCHES, BATCH = 3, 4  # columns of the paper's figure, and its batch size
ON_CURVE = 2.0  # metres
DOTS = 400  # drawn of each centre
STRIPES = (15.0, 35.0)  # metres: ranges at which the distribution of the other is drawn
COLORS = (result.BLUE, result.ORANGE, result.GREEN, result.PURPLE)
PUBLISHED = (
    "Section 'Analysis', figure 'Visual validation' (KITTI, batch size 4): pair-wise positives "
    "form 'U' shapes and are highly correlated, their correlation varies across batches; "
    'group-wise ones are more independent and obey one distribution across batches. No numbers.'
)


def correlation_figure(sequences: Mapping[str, Sequence], *, seed: int = 0) -> FigureResult:
    """Draw positives of three batches, pair-wise above, group-wise below.

    Raises:
        GclError: a sequence has no two scans within 60 m, or they share no spot.
    """
    rng = np.random.default_rng([seed, 23])
    drawn = list(draw_positives(sequences, BATCHES * BATCH, seed))
    batches = [drawn[i : i + BATCH] for i in range(0, len(drawn), BATCH)]
    ranges = [
        {
            'pair-wise': [p.pairs.sensor_range.numpy().reshape(-1, 2) for p in batch],
            'group-wise': [two_members(p.groups, rng) for p in batch],
        }
        for batch in batches
    ]
    rows = [row for kind in KINDS for row in _rows(kind, batches, [r[kind] for r in ranges], rng)]
    svg = _draw(batches, ranges, rows, rng)
    return FigureResult('correlation', _caption(rows, drawn), svg, rows, PUBLISHED)


def _rows(
    kind: str, batches: list[list[Positives]], ranges: list[list[Ranges]], rng: np.random.Generator
) -> list[Row]:
    """One row a panel.

    `bits` is what one range tells of the other in one pair or the groups of one centre (mean),
    `bits_batch` in the batch as a whole, `change` how far its distribution is from other batches'.
    """
    counts = [np.mean([histogram(r) for r in own], axis=0) for own in ranges]
    rows = []
    for number, (batch, own) in enumerate(zip(batches, ranges)):
        evenly = np.concatenate([r[rng.permutation(len(r))[: min(map(len, own))]] for r in own])
        others = [total_variation(counts[number], c) for i, c in enumerate(counts) if i != number]
        curves = [near_curve(r, p.b, p.h, ON_CURVE) for r, p in zip(own, batch) if len(r)]
        rows.append(
            {
                'kind': kind,
                'batch': number + 1,
                'centres': [f'{p.place.sequence}:{p.place.scans[0]}' for p in batch],
                'b_m': [round(p.b, 1) for p in batch],
                'h_m': [round(p.h, 1) for p in batch],
                'positives': sum(len(r) for r in own),
                'bits': round(float(np.mean([shared_bits(r, rng) for r in own])), 3),
                'bits_batch': round(shared_bits(evenly, rng), 3),
                'on_curve': round(float(np.mean(curves)), 3) if curves else None,
                'change': round(float(np.mean(others)), 3) if others else None,
            }
        )
    return rows


def _caption(rows: list[Row], drawn: list[Positives]) -> str:
    def both(key: str) -> str:
        means = [
            np.mean([r[key] for r in rows if r['kind'] == kind and r[key] is not None] or [np.nan])
            for kind in KINDS
        ]
        return f'{means[0]:.2f} pair-wise, {means[1]:.2f} group-wise'

    names = ', '.join(sorted({p.place.sequence for p in drawn}))
    several = rows[0]['change'] is not None
    change = f' Change from batch to batch (total variation): {both("change")}.' * several
    return (
        f'Ranges of positives to two sensors that see them; {names}, batches of '
        f'{BATCH} centre scans (colours). Lines: equation 2 at the distance b of each pair and '
        'the median h of its spots. Grey, sideways: distribution at one range. One range tells of '
        f'the other, within a pair or the groups of a centre: {both("bits")} (bits). Within '
        f'{ON_CURVE:g} m of the curve: {both("on_curve")} (share).{change}'
    )


def _draw(
    batches: list[list[Positives]],
    ranges: list[dict[str, list[Ranges]]],
    rows: list[Row],
    rng: np.random.Generator,
) -> str:
    figure = result.new_figure(10.5, 7.2)
    grid = figure.subplots(2, len(batches), sharex=True, sharey=True, squeeze=False)
    for place, row in enumerate(rows):
        axes = grid[divmod(place, len(batches))]
        batch, own = batches[row['batch'] - 1], ranges[row['batch'] - 1][row['kind']]
        for color, dots in zip(COLORS, own):
            shown = dots[rng.permutation(len(dots))[:DOTS]]
            axes.scatter(*shown.T, s=6, color=color, alpha=0.5, linewidths=0, rasterized=True)
        if row['kind'] == 'pair-wise':
            for color, positives in zip(COLORS, batch):
                axes.plot(*roadside(positives.b, positives.h).T, color=color, linewidth=1.2)
        for at in STRIPES:
            _stripe(axes, np.concatenate(own), at)
        title = f'{row["kind"]}, batch {row["batch"]}: {row["bits"]:.2f} bits'
        result.tidy(axes, x='range to one sensor, m', y='to the other, m', title=title)
        axes.label_outer()
        axes.set(xlim=(0, 70), ylim=(0, 70), aspect='equal')
    return result.to_svg(figure, 'correlation')


def _stripe(axes: Any, ranges: Ranges, at: float) -> None:
    """Draw the distribution of the second range where the first is about `at` metres."""
    beside = ranges[abs(ranges[:, 0] - at) < 1.5, 1]
    if len(beside) == 0:
        return
    counts, edges = np.histogram(beside, bins=np.arange(0, 71, 2.0))
    width = 9.0 * counts / counts.max()
    axes.fill_betweenx(
        np.repeat(edges, 2)[1:-1], at, at + np.repeat(width, 2), color='black', alpha=0.45, lw=0
    )
