"""Kinds of place a seed can turn into, and how often each is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcl_core.errors import GclError


@dataclass(frozen=True)
class Kind:
    """A kind of place.

    Attributes:
        share: how often it is drawn.
        styles: share of each style of lot (see `lots.py`) along the road.
        half_road: half the roadway's width, smallest and largest, metres.
        sidewalk: width of the pavement, smallest and largest, metres; none when 0.
        bend: how much the road winds; 1 is a street with radii above 95 m.
        hills: how hilly; 1 is a few metres over the whole street.
        crossings: side streets, smallest and largest distance between two, metres.
        parked: largest share of the kerb taken by parked cars.
        street_trees: largest share of the kerb with trees; an avenue's is above 1.
        vehicles: moving vehicles within the 380 m of road, on average.
        people: pedestrians and cyclists, on average.
        bridge: probability of a bridge over the road.
        side_streets: share of houses among what lines a side street; the others are trees.
        storeys: height of those houses, and of those in the background, metres.
        background: share of the ground's far edge with buildings.
    """

    share: float
    styles: dict[str, float]
    half_road: tuple[float, float] = (2.8, 7.0)
    sidewalk: tuple[float, float] = (1.0, 5.0)
    bend: float = 1.0
    hills: float = 1.0
    crossings: tuple[float, float] = (35.0, 140.0)
    parked: float = 0.7
    street_trees: float = 0.6
    vehicles: float = 8.0
    people: float = 6.0
    bridge: float = 0.05
    side_streets: float = 0.6
    storeys: tuple[float, float] = (3.0, 9.0)
    background: float = 0.5


KINDS = {
    'mixed': Kind(0.2, {'suburb': 0.4, 'town': 0.25, 'green': 0.2, 'open': 0.15}),
    'residential': Kind(
        0.26,
        {'suburb': 0.65, 'town': 0.15, 'green': 0.08, 'terrace': 0.06, 'square': 0.06},
        half_road=(2.6, 6.0),
        sidewalk=(1.0, 4.5),
        parked=0.6,
        bend=1.2,
        hills=1.5,
        vehicles=3.0,
        people=4.0,
    ),
    'avenue': Kind(
        0.12,
        {'suburb': 0.35, 'town': 0.3, 'green': 0.25, 'terrace': 0.1},
        sidewalk=(2.0, 6.0),
        street_trees=1.6,
        people=10.0,
    ),
    'terraces': Kind(
        0.1,
        {'terrace': 0.75, 'town': 0.1, 'walled': 0.15},
        half_road=(2.8, 4.5),
        bend=0.5,
        crossings=(50.0, 120.0),
    ),
    'canyon': Kind(
        0.12,
        {'canyon': 0.7, 'town': 0.2, 'square': 0.1},
        half_road=(3.5, 9.0),
        sidewalk=(2.0, 5.0),
        bend=0.2,
        hills=0.4,
        crossings=(60.0, 120.0),
        vehicles=22.0,
        people=25.0,
        bridge=0.1,
        side_streets=0.95,
        storeys=(12.0, 30.0),
        background=0.9,
    ),
    'industrial': Kind(
        0.1,
        {'industry': 0.5, 'carpark': 0.2, 'open': 0.15, 'walled': 0.15},
        half_road=(3.5, 7.0),
        hills=0.4,
        parked=0.4,
        street_trees=0.25,
        people=2.0,
        bridge=0.15,
        side_streets=0.4,
        background=0.6,
    ),
    'park': Kind(
        0.08,
        {'park': 0.5, 'square': 0.2, 'carpark': 0.2, 'open': 0.1},
        hills=1.5,
        people=15.0,
        side_streets=0.25,
        background=0.7,
        storeys=(5.0, 16.0),
    ),
    'rural': Kind(
        0.1,
        {'field': 0.55, 'green': 0.25, 'farm': 0.12, 'open': 0.08},
        half_road=(2.4, 4.0),
        sidewalk=(0.0, 0.0),
        bend=2.2,
        hills=3.0,
        crossings=(120.0, 300.0),
        parked=0.03,
        street_trees=0.2,
        vehicles=4.0,
        people=1.0,
        bridge=0.1,
        side_streets=0.1,
        background=0.05,
    ),
}


def kind_of(seed: int, name: str | None = None) -> tuple[str, Kind]:
    """Return the kind of place that a seed stands for, or the one asked for.

    Raises:
        GclError: no such kind.
    """
    if name is None:
        shares = np.array([kind.share for kind in KINDS.values()])
        name = str(np.random.default_rng([seed, 8]).choice(list(KINDS), p=shares / shares.sum()))
    if name not in KINDS:
        raise GclError(f'unknown world {name!r}; choose one of {", ".join(KINDS)}')
    return name, KINDS[name]
