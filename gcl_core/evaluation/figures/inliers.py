"""How many matches are right over distance, and how many pairs have enough: inlier ratio, FMR.

Paper, appendix, "Generalization to ETH", table of feature-match recall (FMR).
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.data.pairs import BINS
from gcl_core.errors import GclError
from gcl_core.evaluation.feature_metrics import TAU1, TAU2, feature_match_recall, inlier_ratio
from gcl_core.evaluation.figures import result
from gcl_core.evaluation.figures.compared import Compared
from gcl_core.evaluation.figures.result import FigureResult, Row
from gcl_core.evaluation.metrics import wilson
from gcl_core.evaluation.neighborhood import Neighborhood
from gcl_core.matching.match import MatchConfig, match
from gcl_core.types import Features

PER_BIN = 6  # most pairs of each distance
PUBLISHED = (
    "Appendix, 'Generalization to ETH' (0.05 m voxels, τ1 = 0.1 m, τ2 = 5 %), mean FMR over four "
    'scenes: GCL+Conv 53.2 %, GCL+KPConv 50.8 %, FCGF 47.0 %, Predator 24.0 %. Nothing on KITTI '
    'or nuScenes.'
)
Bin = tuple[int, int]
Drawn = tuple[int, int, int]


def inliers_figure(compared: Compared) -> FigureResult:
    """Draw inlier ratio and feature-match recall of each method over distance.

    Raises:
        GclError: no two scans 5 to 50 m apart.
    """
    drawn = draw(compared.places, np.random.default_rng([compared.seed, 27]))
    if not drawn:
        raise GclError(f'{compared.drives}: no two scans 5 to 50 m apart; take a longer drive')
    rows = []
    for name, features in compared.features.items():
        ratios = measure(compared.places, drawn, features, compared.match)
        rows += [_row(name, bin_, ratios[bin_]) for bin_ in drawn]
    return FigureResult(
        'inliers', _caption(compared, rows), _draw(rows, compared.colors), rows, PUBLISHED
    )


def draw(places: list[Neighborhood], rng: np.random.Generator) -> dict[Bin, list[Drawn]]:
    """Draw pairs among the scans of each place, so that a scan serves in several.

    Returns:
        Place in `places`, source and target in its `scans`, by distance.
    """
    found: dict[Bin, list[Drawn]] = {}
    for number, place in enumerate(places):
        where = place.T_centre_scan[:, :3, 3]
        for source, target in combinations(range(len(where)), 2):
            apart = np.linalg.norm(where[source] - where[target])
            for bin_ in BINS:
                if bin_[0] <= apart < bin_[1]:
                    found.setdefault(bin_, []).append((number, source, target))
    return {
        bin_: [found[bin_][i] for i in sorted(rng.permutation(len(found[bin_]))[:PER_BIN])]
        for bin_ in sorted(found)
    }


def measure(
    places: list[Neighborhood],
    drawn: dict[Bin, list[Drawn]],
    features: list[list[Features]],
    config: MatchConfig,
) -> dict[Bin, list[float]]:
    """Match, and count right matches of each pair."""

    def ratio(place: int, source: int, target: int) -> float:
        own, poses = features[place], places[place].T_centre_scan
        T_target_source = se3.inverse(poses[target]) @ poses[source]
        matches = match(source=own[source], target=own[target], config=config)
        return inlier_ratio(matches, T_target_source)

    return {bin_: [ratio(*pair) for pair in pairs] for bin_, pairs in drawn.items()}


def _row(name: str, bin_: Bin, ratios: list[float]) -> Row:
    enough, pairs = feature_match_recall(ratios)
    low, high = wilson(enough, pairs)
    return {
        'method': name,
        'lo_m': bin_[0],
        'hi_m': bin_[1],
        'pairs': pairs,
        'inlier_ratio': round(float(np.median(ratios)), 4),
        'lowest': round(min(ratios), 4),
        'highest': round(max(ratios), 4),
        'fmr': round(enough / pairs, 4),
        'fmr_low': round(low, 4),
        'fmr_high': round(high, 4),
    }


def _caption(compared: Compared, rows: list[Row]) -> str:
    pairs = sum(row['pairs'] for row in rows if row['method'] == rows[0]['method'])
    return (
        f'{pairs} pairs among the scans of {len(compared.places)} places of {compared.drives}, '
        'described at one heading, matched as the registrar does. Left: share of matches right '
        f'within τ1 = {TAU1:g} m; median, lowest and highest pair of each distance. Right: share '
        'of pairs with more than '
        f'τ2 = {100 * TAU2:g} % right ones (feature-match recall, FMR), with its 95 % Wilson '
        'interval; pairs of one place are correlated, so the true uncertainty is larger.'
    )


def _draw(rows: list[Row], colors: dict[str, str]) -> str:
    figure = result.new_figure(10.5, 4.2)
    ratio, recall = figure.subplots(1, 2)
    names = list(dict.fromkeys(row['method'] for row in rows))
    for place, name in enumerate(names):
        own = [row for row in rows if row['method'] == name]
        shift = 0.6 * (place - (len(names) - 1) / 2)
        x = np.array([(row['lo_m'] + row['hi_m']) / 2 for row in own]) + shift
        for axes, keys in (
            (ratio, ('inlier_ratio', 'lowest', 'highest')),
            (recall, ('fmr', 'fmr_low', 'fmr_high')),
        ):
            middle, low, high = (np.array([100 * row[key] for row in own]) for key in keys)
            spread = np.maximum([middle - low, high - middle], 0)
            style: Any = {'color': colors[name], 'capsize': 2, 'elinewidth': 1}
            axes.errorbar(x, middle, spread, marker='o', ms=4, label=name, **style)
    between = 'distance between the sensors, m'
    result.tidy(ratio, x=between, y='right matches, %', title='inlier ratio')
    result.tidy(recall, x=between, y='pairs, %', title='feature-match recall')
    result.level(ratio, 100 * TAU2, label='τ2')
    ratio.set_ylim(bottom=0)
    recall.set_ylim(0, 102)
    result.legend(ratio)
    return result.to_svg(figure, 'inliers')
