"""How far a feature moves when its spot is seen from farther away than at its best.

Paper, figures "Feature drift grows with increasing distance" and "Distribution of feature drift".
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree

from gcl_core.evaluation.feature_metrics import feature_drift
from gcl_core.evaluation.figures import result
from gcl_core.evaluation.figures.compared import Compared
from gcl_core.evaluation.figures.result import FigureResult, Row
from gcl_core.evaluation.figures.sampling import densest, shared_spots
from gcl_core.evaluation.neighborhood import MAX_RANGE, Neighborhood
from gcl_core.types import Features, PositiveGroups

EDGES = np.arange(0.0, MAX_RANGE + 1, 10.0)  # metres: ranges of observations
WHOLE = (float(EDGES[0]), float(EDGES[-1]))
FEWEST = 50  # observations in a range, for it to be drawn
VIOLIN = 5000  # observations that a violin is smoothed from
PUBLISHED = (
    "Figures 'Feature drift grows' and 'Distribution of feature drift' (KITTI): drift grows about "
    'linearly with the distance from the sensor; GCL drifts less than its pair-wise counterpart '
    'with both backbones, in mean and in spread. No numbers.'
)


@dataclass(frozen=True)
class Drift:
    """Observations of spots by one kind of features, each spot's finest left out.

    Attributes:
        range: from each observation to its sensor, metres.
        drift: distance of its feature from the finest one of its spot.
        unrelated: the same between features of different spots, median.
    """

    range: Float[np.ndarray, ' n']
    drift: Float[np.ndarray, ' n']
    unrelated: float


def drift_figure(compared: Compared) -> FigureResult:
    """Draw drift of each method, as a whole and over range.

    Raises:
        GclError: the scans of a place share no spot.
    """
    places, seed = compared.places, compared.seed
    groups = [densest(place, shared_spots(place)) for place in places]
    measured = {
        name: measure(places, groups, features, seed)
        for name, features in compared.features.items()
    }
    rows = [row for name, found in measured.items() for row in _rows(name, found)]
    svg = _draw(measured, rows, compared.colors, np.random.default_rng([seed, 26]))
    return FigureResult('drift', _caption(compared, groups, measured), svg, rows, PUBLISHED)


def measure(
    places: list[Neighborhood],
    groups: list[PositiveGroups],
    features: list[list[Features]],
    seed: int,
) -> Drift:
    """Measure the drift at every spot.

    The feature of an observation is that of the nearest key point of its scan, so that methods
    with different key points are compared at the same spots.
    """
    rng = np.random.default_rng([seed, 25])
    ranges, drifts, unrelated = [], [], []
    for place, spots, described in zip(places, groups, features, strict=True):
        at_points = [at(f, p) for f, p in zip(described, place.points, strict=True)]
        descriptors = torch.cat(at_points).float()
        moved = feature_drift(descriptors, spots).numpy()
        others = np.ones(len(moved), bool)
        others[spots.finest.numpy()] = False
        ranges.append(spots.sensor_range.numpy()[others])
        drifts.append(moved[others])
        own = descriptors[spots.member[spots.finest]]
        shuffled = own[torch.from_numpy(rng.permutation(len(own)))]
        unrelated.append((own - shuffled).norm(dim=1).numpy())
    return Drift(
        np.concatenate(ranges), np.concatenate(drifts), float(np.median(np.concatenate(unrelated)))
    )


def at(features: Features, points: Float[torch.Tensor, 'n 3']) -> Float[torch.Tensor, 'n d']:
    """Descriptor of the key point nearest to each point."""
    _, nearest = cKDTree(features.points.numpy()).query(points.numpy())
    return features.descriptors[torch.from_numpy(nearest)]


def _rows(name: str, found: Drift) -> list[Row]:
    """A row for each ring of range, and one for all of them together.

    `relative` is the median in units of the drift between unrelated spots.
    """
    rows = []
    for low, high in [WHOLE, *pairwise(EDGES)]:
        inside = found.drift[(found.range >= low) & (found.range < high)]
        if len(inside) < FEWEST:
            continue
        q25, median, q75 = np.percentile(inside, [25, 50, 75])
        rows.append(
            {
                'method': name,
                'lo_m': float(low),
                'hi_m': float(high),
                'observations': len(inside),
                'mean': round(float(inside.mean()), 4),
                'deviation': round(float(inside.std()), 4),
                'q25': round(float(q25), 4),
                'median': round(float(median), 4),
                'q75': round(float(q75), 4),
                'unrelated': round(found.unrelated, 4),
                'relative': round(float(median) / found.unrelated, 4),
            }
        )
    return rows


def _caption(compared: Compared, groups: list[PositiveGroups], measured: dict[str, Drift]) -> str:
    medians = {name: float(np.median(found.drift)) for name, found in measured.items()}
    said = ', '.join(
        f'{name} {median:.2f} of {measured[name].unrelated:.2f} '
        f'({median / measured[name].unrelated:.2f})'
        for name, median in medians.items()
    )
    return (
        'Distance of the feature of an observation from the one of the densest observation of the '
        f'same spot; {sum(map(len, groups))} spots around {len(groups)} scans of '
        f'{compared.drives}. Left: all observations but the densest. Features that lie close '
        'together altogether drift '
        'little and tell little: so right, median and quartiles over range, in units of the '
        'median distance between unrelated spots, where 1 means that nothing is recognised. '
        f'Median drift of that between unrelated spots (ratio): {said}.'
    )


def _draw(
    measured: dict[str, Drift], rows: list[Row], colors: dict[str, str], rng: np.random.Generator
) -> str:
    figure = result.new_figure(10.5, 4.4)
    violins, curve = figure.subplots(1, 2, gridspec_kw={'width_ratios': (1, 1.4)})
    for place, (name, found) in enumerate(measured.items()):
        _violin(violins, place, found, colors[name], rng)
        own = [r for r in rows if r['method'] == name and (r['lo_m'], r['hi_m']) != WHOLE]
        middle = [(row['lo_m'] + row['hi_m']) / 2 for row in own]
        low, median, high = (
            [row[key] / found.unrelated for row in own] for key in ('q25', 'median', 'q75')
        )
        curve.plot(middle, median, color=colors[name], marker='o', ms=4, label=name)
        curve.fill_between(middle, low, high, color=colors[name], alpha=0.15, linewidth=0)
    violins.set_xticks(range(len(measured)), list(measured))
    result.tidy(violins, x='', y='feature drift (unit features)', title='all observations')
    title = 'over range, in units of unrelated spots'
    result.tidy(curve, x='range from the sensor, m', y='relative feature drift', title=title)
    violins.set_ylim(bottom=0)
    curve.set_ylim(bottom=0)
    result.level(curve, 1)
    for axes in (violins, curve):
        result.legend(axes)
    return result.to_svg(figure, 'drift')


def _violin(axes: Any, place: int, found: Drift, color: str, rng: np.random.Generator) -> None:
    """Draw one distribution, its quartiles, and a star at the drift between unrelated spots."""
    values = rng.permutation(found.drift)[:VIOLIN]
    (body,) = axes.violinplot([values], [place], widths=0.8, showextrema=False)['bodies']
    body.set(facecolor=color, alpha=0.5, linewidth=0)
    quartiles, half = np.percentile(found.drift, [25, 50, 75]), np.array([0.1, 0.2, 0.1])
    label = None if place else 'quartiles'
    axes.hlines(quartiles, place - half, place + half, color=color, linewidth=2, label=label)
    label = None if place else 'between unrelated spots'
    axes.plot(place, found.unrelated, '*', color=color, mec='black', mew=0.5, ms=11, label=label)
