"""Where positives lie around the centre scan: pairs on roadside lines, groups wherever it sees.

Paper, section "Overview of GCL", figure "Spatial distribution of 2000 random sampled positives".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.sequence import Sequence
from gcl_core.evaluation.figures import result
from gcl_core.evaluation.figures.dependence import total_variation
from gcl_core.evaluation.figures.result import FigureResult, Row
from gcl_core.evaluation.figures.sampling import KINDS, Positives, draw_positives
from gcl_core.evaluation.neighborhood import MAX_RANGE, Neighborhood
from gcl_core.types import PositiveGroups

FIELDS = {'pair-wise': 'pairs', 'group-wise': 'groups'}  # of `Positives`
LABELS = {'points': 'all points of the centre', **{kind: f'{kind} positives' for kind in KINDS}}
COLORS = {'points': result.GREY, 'pair-wise': result.ORANGE, 'group-wise': result.BLUE}
CENTRES = 8
APART = 40.0  # metres between the scans of a pair: distant, as in the paper's picture
DRAWN = 2000  # positives, as in the paper
EDGES = np.arange(0.0, MAX_RANGE + 1, 5.0)  # rings of range, metres
CELL = 10.0  # metres, seen from above
WINDOW = 45.0  # metres to each side in the picture
PUBLISHED = (
    "Section 'Positive Group Searching': 87 % ± 5.4 % of the points of a centre scan form a group "
    "(KITTI). Figure 'Spatial distribution': pair-wise positives lie in the limited overlap and "
    'on roadside lines, group-wise ones obey the distribution of the centre scan. Else no numbers.'
)


def positives_figure(sequences: Mapping[str, Sequence], *, seed: int = 0) -> FigureResult:
    """Draw positives of one centre from above, and of several over range.

    Raises:
        GclError: a sequence has no two scans within 60 m, or they share no spot.
    """
    drawn = list(draw_positives(sequences, CENTRES, seed, apart=APART))
    rows = _rows(drawn)
    svg = _draw(drawn[0], rows, np.random.default_rng([seed, 24]))
    return FigureResult('positives', _caption(drawn), svg, rows, PUBLISHED)


def _rings(points: Float[torch.Tensor, 'n 3']) -> Float[np.ndarray, ' k']:
    """Points in each ring around the centre's sensor."""
    return np.histogram(np.linalg.norm(points.numpy(), axis=1), EDGES)[0].astype(float)


def _rows(drawn: list[Positives]) -> list[Row]:
    """One row a ring, over all centres.

    `points` of the centre scans, and how many of them are positives of pairs and of groups.
    """
    counted = (
        [_rings(p.place.points[0]), _rings(p.pairs.anchor), _rings(p.groups.anchor)] for p in drawn
    )
    points, pairs, groups = np.sum(list(counted), axis=0).astype(int).tolist()
    return [
        {'lo_m': low, 'hi_m': high, 'points': n, 'pair-wise': m, 'group-wise': g}
        for low, high, n, m, g in zip(
            EDGES[:-1].tolist(), EDGES[1:].tolist(), points, pairs, groups
        )
    ]


def _columns(rows: list[Row]) -> dict[str, Float[np.ndarray, ' k']]:
    return {key: np.array([row[key] for row in rows], float) for key in ('points', *KINDS)}


def _bias(taken: Positives, spots: PositiveGroups) -> float:
    """Total variation between positives and points of a centre, seen from above."""
    edges = np.arange(-MAX_RANGE, MAX_RANGE + CELL, CELL)
    shares = []
    for points in (taken.place.points[0].numpy(), spots.anchor.numpy()):
        counts = np.histogram2d(points[:, 0], points[:, 1], bins=(edges, edges))[0]
        shares.append(counts / max(counts.sum(), 1))
    return total_variation(*shares)


def _caption(drawn: list[Positives]) -> str:
    first = drawn[0]

    def share(kind: str) -> str:
        values = [100 * len(getattr(p, FIELDS[kind])) / len(p.place.points[0]) for p in drawn]
        return f'{np.mean(values):.0f} % ± {np.std(values):.1f} %'

    def bias(kind: str) -> float:
        return float(np.mean([_bias(p, getattr(p, FIELDS[kind])) for p in drawn]))

    return (
        f'Above: up to {DRAWN} random positives (red) of scan {first.place.scans[0]} of '
        f'{first.place.sequence} with one scan {first.b:.0f} m away, and with '
        f'{len(first.place.scans) - 1} neighbours; squares are sensors. Below: over {len(drawn)} '
        f'centre scans, partners {np.mean([p.b for p in drawn]):.0f} m away on average. Of '
        f"the centres' points {share('pair-wise')} are positives of a pair, {share('group-wise')} "
        'of a group. Distance of their distribution from that of all points, seen from above in '
        f'cells of {CELL:g} m (total variation): {bias("pair-wise"):.2f} and '
        f'{bias("group-wise"):.2f}.'
    )


def _draw(first: Positives, rows: list[Row], rng: np.random.Generator) -> str:
    figure = result.new_figure(10.5, 8.6)
    above, below = figure.subplots(2, 2, gridspec_kw={'height_ratios': (1.5, 1)})
    place, chosen = first.place, {'pair-wise': [first.partner]}
    for axes, kind in zip(above, KINDS):
        scans = chosen.get(kind, list(range(1, len(place.scans))))
        _birds_eye(axes, place, scans, getattr(first, FIELDS[kind]).anchor.numpy(), rng)
        result.tidy(axes, x='x, m (centre frame)', y='y, m', title=f'{kind} positives')
    columns, middle = _columns(rows), (EDGES[1:] + EDGES[:-1]) / 2
    for key, color in COLORS.items():
        counts, label = columns[key], LABELS[key]
        share = 100 * counts / max(counts.sum(), 1)
        below[0].stairs(share, EDGES, color=color, linewidth=1.8, label=label)
        if key in KINDS:
            with np.errstate(invalid='ignore'):
                formed = 100 * counts / columns['points']
            below[1].plot(middle, formed, color=color, marker='o', ms=4, label=label)
    range_label = 'range from the centre sensor, m'
    result.tidy(below[0], x=range_label, y='share of all, % in 5 m', title='where they lie')
    result.tidy(below[1], x=range_label, y="of the centre's points, %", title='how many there are')
    below[1].set_ylim(0, 100)
    result.legend(below[0])
    return result.to_svg(figure, 'positives')


def _birds_eye(
    axes: Any,
    place: Neighborhood,
    scans: list[int],
    spots: Float[np.ndarray, 'n 3'],
    rng: np.random.Generator,
) -> None:
    """Draw the centre and some neighbours from above, in the centre's frame, and positives."""
    style: Any = {'linewidths': 0, 'rasterized': True}
    for scan, color in [*((scan, result.SKY) for scan in scans), (0, result.GREY)]:
        T = place.T_centre_scan[scan]
        points = se3.transform(T, place.points[scan].numpy())
        axes.scatter(points[:, 0], points[:, 1], s=0.5, color=color, alpha=0.35, **style)
        axes.plot(*T[:2, 3], 's', color=color, mec='black', ms=6, zorder=3)
    shown = spots[rng.permutation(len(spots))[:DRAWN]]
    axes.scatter(shown[:, 0], shown[:, 1], s=3, color=result.RED, alpha=0.7, **style)
    axes.set(xlim=(-WINDOW, WINDOW), ylim=(-WINDOW, WINDOW), aspect='equal')
