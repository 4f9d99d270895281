"""What fills a lot beside the road, style by style."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gcl_core.data.simulator import furniture, vegetation, vehicles
from gcl_core.data.simulator.buildings import hall, house
from gcl_core.data.simulator.primitives import Triangles


@dataclass(frozen=True)
class Lot:
    """A stretch of roadside.

    Attributes:
        put: place a part (triangles, surface, metres along from the lot's middle, metres out
            from the pavement's edge, yaw against facing the road).
        length: metres along the road.
        rng: decides what stands here.
    """

    put: Callable[[Triangles, str, float, float, float], None]
    length: float
    rng: np.random.Generator

    def along(self, share: float = 0.5) -> float:
        """A random place along the lot, metres from its middle."""
        return float(self.rng.uniform(-share, share) * self.length)


def _greenery(lot: Lot, trees: float, bushes: float, first: float = 1.2) -> None:
    rng = lot.rng
    for _ in range(rng.poisson(trees)):
        out = rng.uniform(first + 0.4, 40.0)
        part = vegetation.tree(rng, detail=1.0 if out < 12.0 else 0.4, roadside=out < 5.0)
        lot.put(part, 'leaf', lot.along(), out, 0.0)
    for _ in range(rng.poisson(bushes)):
        lot.put(vegetation.bush(rng), 'leaf', lot.along(), rng.uniform(first, 20.0), 0.0)


def _boundary(lot: Lot, front: float, side: float) -> None:
    """Hedges, fences or walls along the pavement and between lots, with these probabilities."""
    rng = lot.rng
    for odds, across in ((front, False), (side, True)):
        if rng.random() >= odds:
            continue
        run = rng.uniform(6, 25) if across else lot.length * rng.uniform(0.5, 1.0)
        if rng.random() < 0.5:
            part, surface = vegetation.hedge(run, rng), 'leaf'
        else:
            part, surface = furniture.fence(run, rng), 'facade'
        if across:
            lot.put(part, surface, lot.length / 2, 0.5 + run / 2, np.pi / 2)
        else:
            lot.put(part, surface, 0.0, rng.uniform(0.2, 1.0), 0.0)


def _clutter(lot: Lot, count: float, depth: float) -> None:
    for _ in range(lot.rng.poisson(count)):
        part = furniture.clutter(lot.rng)
        lot.put(part, 'metal', lot.along(), lot.rng.uniform(0.2, depth), lot.rng.uniform(0, 3))


def _behind(lot: Lot, odds: float, nearest: float, farthest: float) -> None:
    """A building in the second row."""
    rng = lot.rng
    if rng.random() < odds:
        part = house(rng.uniform(8, 16), rng.uniform(7, 14), rng.uniform(3, 8), rng)
        out = rng.uniform(nearest, farthest)
        lot.put(part, 'facade', rng.normal() * 4, out, rng.uniform(-0.5, 0.5))


def suburb(lot: Lot) -> None:
    """Detached house in a garden, a hedge or fence in front, a car in the drive."""
    rng = lot.rng
    setback, width = rng.uniform(3, 16), rng.uniform(7, 13)
    part = house(rng.uniform(0.5, 0.8) * lot.length, width, rng.uniform(2.8, 7.5), rng)
    lot.put(part, 'facade', rng.normal(), setback + width / 2, rng.normal() * 0.04)
    _behind(lot, 0.8, setback + 24, setback + 40)
    _boundary(lot, 0.35, 0.6)
    _greenery(lot, 4.5, 10.0)
    if rng.random() < 0.4:
        out = rng.uniform(2.5, max(3.0, setback))
        lot.put(vehicles.car(rng), 'paint', lot.along(0.4), out, np.pi / 2)
    _clutter(lot, 1.5, setback + 1)


def town(lot: Lot) -> None:
    """House of two to five storeys, hardly any gap to the next."""
    rng = lot.rng
    setback, width = rng.uniform(0, 6), rng.uniform(9, 14)
    length = lot.length * rng.uniform(0.85, 1.0)
    part = house(length, width, rng.uniform(6, 16), rng, flat=rng.random() < 0.4)
    lot.put(part, 'facade', 0.0, setback + width / 2, 0.0)
    _behind(lot, 0.3, setback + 24, setback + 40)
    _greenery(lot, 0.7, 1.4)
    _clutter(lot, 1.0, setback + 1)


def green(lot: Lot) -> None:
    """Trees and bushes, here and there a house behind them."""
    rng = lot.rng
    if rng.random() < 0.25:
        width = rng.uniform(7, 13)
        part = house(0.65 * lot.length, width, rng.uniform(2.8, 7.5), rng)
        lot.put(part, 'facade', rng.normal(), rng.uniform(3, 12) + width / 2, rng.normal() * 0.04)
    _behind(lot, 0.4, 30, 60)
    _boundary(lot, 0.25, 0.2)
    _greenery(lot, 8.0, 14.0)
    _clutter(lot, 1.0, 8)


def open_ground(lot: Lot) -> None:
    """Little on it, a house in the distance."""
    _behind(lot, 0.6, 30, 60)
    _boundary(lot, 0.25, 0.1)
    _greenery(lot, 1.5, 3.0)
    _clutter(lot, 1.0, 8)


def terrace(lot: Lot) -> None:
    """The same house again and again: what a descriptor cannot tell apart."""
    rng = lot.rng
    pitch, width, height = rng.uniform(5, 8), rng.uniform(8, 11), rng.uniform(5, 9)
    setback, garden = rng.uniform(0.5, 5.0), rng.random() < 0.5
    part = house(pitch, width, height, rng, gable_along=True)
    front = furniture.fence(pitch * 0.8, rng)
    for along in np.arange(-lot.length / 2 + pitch / 2, lot.length / 2, pitch):
        lot.put(part, 'facade', float(along), setback + width / 2, 0.0)
        if garden and setback > 1.5:
            lot.put(front, 'facade', float(along), 0.3, 0.0)
    _greenery(lot, 1.0, 3.0, first=setback + width + 2)


def canyon(lot: Lot) -> None:
    """Blocks of 15 to 40 m without gaps, shop windows, all one street wall."""
    rng = lot.rng
    width, height = rng.uniform(12, 20), rng.uniform(15, 40)
    part = house(lot.length * rng.uniform(0.95, 1.0), width, height, rng, flat=True)
    glass = rng.random() < 0.25
    lot.put(part, 'glass' if glass else 'facade', 0.0, rng.uniform(0, 1.0) + width / 2, 0.0)
    _clutter(lot, 1.5, 0.8)


def industry(lot: Lot) -> None:
    """A hall behind a fence, a yard with trucks, containers and heaps."""
    rng = lot.rng
    setback, width = rng.uniform(6, 25), rng.uniform(15, 40)
    part = hall(lot.length * rng.uniform(0.6, 0.9), width, rng.uniform(5, 12), rng)
    lot.put(part, 'metal', 0.0, setback + width / 2, rng.normal() * 0.03)
    if rng.random() < 0.6:
        lot.put(furniture.fence(lot.length * 0.8, rng), 'metal', 0.0, rng.uniform(0.3, 2), 0.0)
    for _ in range(rng.poisson(2.0)):
        yaw = rng.choice([0.0, np.pi / 2]) + rng.normal() * 0.05
        out = rng.uniform(3.0, max(4.0, setback - 3))
        lot.put(vehicles.truck(rng), 'paint', lot.along(0.4), out, yaw)
    for _ in range(rng.poisson(2.0)):
        lot.put(vehicles.car(rng), 'paint', lot.along(), rng.uniform(3, setback), np.pi / 2)
    _clutter(lot, 5.0, setback)
    _greenery(lot, 0.5, 1.0)


def carpark(lot: Lot) -> None:
    """Rows of parked cars, some places empty, lamps between them."""
    rng = lot.rng
    rows, start = rng.integers(1, 5), rng.uniform(3, 6)
    for row in range(rows):
        out = start + 8.5 * row
        for along in np.arange(-lot.length / 2 + 1.5, lot.length / 2 - 1, 2.6):
            if rng.random() < 0.65:
                yaw = np.pi / 2 + rng.normal() * 0.04 + np.pi * rng.integers(0, 2)
                lot.put(vehicles.car(rng), 'paint', float(along) + rng.normal() * 0.1, out, yaw)
        if rng.random() < 0.6:
            lot.put(furniture.lamp(rng), 'metal', lot.along(), out + 3.5, 0.0)
    if rng.random() < 0.5:
        width = rng.uniform(15, 30)
        part = hall(lot.length * 0.9, width, rng.uniform(4, 8), rng)
        lot.put(part, 'facade', 0.0, start + 8.5 * rows + 4 + width / 2, 0.0)
    _greenery(lot, 0.8, 2.0)


def park(lot: Lot) -> None:
    """Lawn with single trees, benches, a path's lamps."""
    rng = lot.rng
    _greenery(lot, rng.uniform(1.0, 5.0), rng.uniform(1.0, 6.0))
    _boundary(lot, 0.3, 0.0)
    _clutter(lot, 2.0, 40.0)
    if rng.random() < 0.4:
        lot.put(furniture.lamp(rng), 'metal', lot.along(), rng.uniform(5, 35), 0.0)


def square(lot: Lot) -> None:
    """Open place with kiosks, bollards and lamps, fronts at its far side."""
    rng = lot.rng
    depth = rng.uniform(20, 45)
    part = house(lot.length, 12.0, rng.uniform(8, 18), rng, flat=rng.random() < 0.5)
    lot.put(part, 'facade', 0.0, depth + 6.0, 0.0)
    _clutter(lot, 6.0, depth)
    for _ in range(rng.poisson(1.5)):
        lot.put(furniture.lamp(rng), 'metal', lot.along(), rng.uniform(2, depth), 0.0)
        lot.put(vegetation.tree(rng), 'leaf', lot.along(), rng.uniform(2, depth), 0.0)
    if rng.random() < 0.4:
        kiosk = house(4.0, 3.0, 2.8, rng, flat=True)
        lot.put(kiosk, 'facade', lot.along(), rng.uniform(4, depth - 3), rng.uniform(0, 3))


def walled(lot: Lot) -> None:
    """A long wall, tree tops or a roof behind it."""
    rng = lot.rng
    lot.put(furniture.wall(lot.length, rng), 'facade', 0.0, rng.uniform(0.2, 1.5), 0.0)
    _behind(lot, 0.6, 12, 40)
    _greenery(lot, 2.0, 1.0, first=2.5)


def field(lot: Lot) -> None:
    """Meadow or crop: now and then a tree, a hedge, a guard rail or poles along the road."""
    rng = lot.rng
    if rng.random() < 0.15:
        lot.put(furniture.guard_rail(lot.length), 'metal', 0.0, 0.6, 0.0)
    if rng.random() < 0.2:
        lot.put(vegetation.hedge(lot.length, rng), 'leaf', 0.0, rng.uniform(1.5, 5), 0.0)
    if rng.random() < 0.4:
        lot.put(furniture.lamp(rng), 'metal', lot.along(), rng.uniform(1, 4), 0.0)
    _boundary(lot, 0.15, 0.15)
    _greenery(lot, 1.5, 5.0)


def farm(lot: Lot) -> None:
    """House, barn, machines."""
    rng = lot.rng
    barn = hall(rng.uniform(12, 25), rng.uniform(8, 14), rng.uniform(4, 7), rng)
    lot.put(barn, 'facade', lot.along(0.3), rng.uniform(25, 40), rng.uniform(-0.5, 0.5))
    lot.put(vehicles.truck(rng), 'paint', lot.along(), rng.uniform(8, 20), rng.uniform(0, 3))
    suburb(lot)


@dataclass(frozen=True)
class Style:
    """How a style fills a lot, and how long its lots are.

    Attributes:
        fill: puts things onto one.
        length: smallest and largest, metres.
    """

    fill: Callable[[Lot], None]
    length: tuple[float, float]


STYLES = {
    'suburb': Style(suburb, (12, 26)),
    'town': Style(town, (9, 24)),
    'green': Style(green, (8, 16)),
    'open': Style(open_ground, (15, 40)),
    'terrace': Style(terrace, (35, 80)),
    'canyon': Style(canyon, (18, 40)),
    'industry': Style(industry, (35, 70)),
    'carpark': Style(carpark, (25, 50)),
    'park': Style(park, (15, 30)),
    'square': Style(square, (30, 50)),
    'walled': Style(walled, (20, 60)),
    'field': Style(field, (20, 50)),
    'farm': Style(farm, (35, 50)),
}
