"""A world: lots with houses and gardens along a road, and the traffic on it."""

from __future__ import annotations

import numpy as np

from gcl_core.data.simulator import furniture, vegetation
from gcl_core.data.simulator.buildings import house
from gcl_core.data.simulator.primitives import Triangles, place
from gcl_core.data.simulator.terrain import REACH, Terrain

STYLES = {'suburb': 0.4, 'town': 0.25, 'green': 0.2, 'open': 0.15}


class Street:
    """Static world of one seed; moving traffic is drawn for each moment by `traffic`."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 0])
        self.terrain = Terrain(rng)
        self._parts: list[Triangles] = [self.terrain.mesh(rng)]
        parked, trees = rng.uniform(0, 0.8, 2), rng.uniform(0, 0.6, 2)
        for index, side in enumerate((-1, 1)):
            self._build_side(side, rng)
            self._line_kerb(side, rng, parked=float(parked[index]), trees=float(trees[index]))
        self.triangles: Triangles = np.concatenate(self._parts)

    def _put(self, part: Triangles, s: float, lateral: float, yaw: float = 0.0) -> None:
        """Stand a part on the ground, its -y side towards the road when `yaw` is 0."""
        x, y = self.terrain.xy(np.array(s), np.array(lateral))
        z = float(self.terrain.height(np.array(s), np.array(lateral))) - 0.05
        turn = self.terrain.heading(s) + (0.0 if lateral > 0 else np.pi)
        self._parts.append(place(part, x=float(x), y=float(y), z=z, yaw=turn + yaw))

    def _build_side(self, side: int, rng: np.random.Generator) -> None:
        """Fill one side of the road, lot after lot, changing style now and then."""
        edge = self.terrain.half_road + self.terrain.sidewalk
        s, style, style_end = -REACH, 'suburb', -np.inf
        while s < REACH:
            if s > style_end:
                style = str(rng.choice(list(STYLES), p=list(STYLES.values())))
                style_end = s + rng.uniform(50, 200)
            lot = {
                'suburb': rng.uniform(12, 26),
                'town': rng.uniform(9, 24),
                'green': rng.uniform(8, 16),
                'open': rng.uniform(15, 40),
            }[style]
            middle = s + lot / 2
            if not bool(self.terrain.in_crossing(np.array(middle), margin=lot / 2)):
                self._fill_lot(style, middle, lot, side, edge, rng)
            else:
                self._fill_corner(middle, side, edge, rng)
            s += lot

    def _fill_lot(
        self, style: str, s: float, lot: float, side: int, edge: float, rng: np.random.Generator
    ) -> None:
        def put(part: Triangles, along: float, out: float, yaw: float = 0.0) -> None:
            self._put(part, s + along, side * (edge + out), yaw)

        setback = rng.uniform(0, 3) if style == 'town' else rng.uniform(3, 12)
        if style == 'suburb' or (style == 'green' and rng.random() < 0.25):
            length, width = rng.uniform(0.5, 0.8) * lot, rng.uniform(7, 13)
            part = house(length, width, rng.uniform(2.8, 7.5), rng)
            put(part, rng.normal(), setback + width / 2, rng.normal() * 0.04)
        elif style == 'town':
            length, width = lot * rng.uniform(0.85, 1.0), rng.uniform(9, 14)
            part = house(length, width, rng.uniform(6, 16), rng, flat=rng.random() < 0.4)
            put(part, 0.0, setback + width / 2)
        if rng.random() < {'suburb': 0.8, 'town': 0.3, 'green': 0.4, 'open': 0.6}[style]:
            width = rng.uniform(7, 14)
            part = house(rng.uniform(8, 16), width, rng.uniform(3, 8), rng)
            far = rng.uniform(28, 60) if style in ('open', 'green') else rng.uniform(24, 40)
            put(part, rng.normal() * 4, setback + far, rng.uniform(-0.5, 0.5))
        if rng.random() < {'suburb': 0.45, 'town': 0.1, 'green': 0.25, 'open': 0.25}[style]:
            kind = vegetation.hedge if rng.random() < 0.5 else furniture.fence
            put(kind(lot * rng.uniform(0.5, 1.0), rng), 0.0, rng.uniform(0.2, 1.0))
        if rng.random() < {'suburb': 0.5, 'town': 0.1, 'green': 0.2, 'open': 0.1}[style]:
            run = rng.uniform(6, 25)
            kind = vegetation.hedge if rng.random() < 0.5 else furniture.fence
            put(kind(run, rng), lot / 2, 0.5 + run / 2, np.pi / 2)
        trees = {'suburb': 3.0, 'town': 0.7, 'green': 6.0, 'open': 1.5}[style]
        for _ in range(rng.poisson(trees)):
            put(vegetation.tree(rng), rng.uniform(-0.5, 0.5) * lot, rng.uniform(1.0, 40.0))
        for _ in range(rng.poisson(2.0 * trees)):
            put(vegetation.bush(rng), rng.uniform(-0.5, 0.5) * lot, rng.uniform(0.5, 20.0))
        if style in ('suburb', 'town') and rng.random() < 0.35:
            out = rng.uniform(2.5, max(3.0, setback))
            put(furniture.car(rng), rng.uniform(-0.4, 0.4) * lot, out, np.pi / 2)
        for _ in range(rng.poisson(1.0)):
            put(
                furniture.clutter(rng), rng.uniform(-0.5, 0.5) * lot, rng.uniform(0.2, setback + 1)
            )

    def _fill_corner(self, s: float, side: int, edge: float, rng: np.random.Generator) -> None:
        """Line a side street with houses that face it, and a few trees."""
        middle, half = min(self.terrain.crossings, key=lambda c: abs(c[0] - s))
        for direction in (-1, 1):
            out = edge + rng.uniform(4, 14)
            while out < 75:
                width = rng.uniform(8, 14)
                offset = half + rng.uniform(3, 7) + width / 2
                if rng.random() < 0.6:
                    part = house(rng.uniform(8, 14), width, rng.uniform(3, 9), rng)
                    # On either side of the road, the front turns to the side street.
                    yaw = -direction * side * np.pi / 2
                    self._put(part, middle + direction * offset, side * out, yaw)
                else:
                    self._put(vegetation.tree(rng), middle + direction * offset, side * out)
                out += rng.uniform(14, 22)

    def _line_kerb(
        self, side: int, rng: np.random.Generator, *, parked: float, trees: float
    ) -> None:
        """Parked cars, lamps, signs, street trees and clutter along the kerb."""
        w = self.terrain.half_road
        s = -REACH
        while s < REACH:
            s += rng.uniform(5.5, 8.0)
            if bool(self.terrain.in_crossing(np.array(s), margin=4.0)):
                continue
            if rng.random() < parked:
                yaw = rng.normal() * 0.03 + np.pi * rng.integers(0, 2)
                self._put(furniture.car(rng), s, side * (w - rng.uniform(0.6, 1.2)), yaw)
            if rng.random() < 0.22:
                self._put(furniture.pole(rng), s + 2.0, side * (w + 0.5), -np.pi / 2)
            if rng.random() < trees:
                self._put(vegetation.tree(rng), s + rng.normal(), side * (w + 0.9))
            if rng.random() < 0.2:
                out = w + rng.uniform(0.4, self.terrain.sidewalk)
                self._put(furniture.clutter(rng), s + rng.normal(), side * out)

    def traffic(self, rng: np.random.Generator, ego_s: float) -> Triangles:
        """Cars, trucks and people on the move at one moment, none within 8 m of the ego car."""
        parts = []
        for _ in range(rng.poisson(5)):
            s = rng.uniform(-REACH, REACH)
            if abs(s - ego_s) < 8.0:
                continue
            lane = rng.choice([-1, 1])
            part = furniture.truck(rng) if rng.random() < 0.12 else furniture.car(rng)
            parts.append(self._moving(part, s, lane * 0.45 * self.terrain.half_road, rng))
        for _ in range(rng.poisson(6)):
            out = self.terrain.half_road + rng.uniform(-0.5, self.terrain.sidewalk)
            s = rng.uniform(-REACH, REACH)
            if abs(s - ego_s) > 3.0:
                part = furniture.person(rng)
                parts.append(self._moving(part, s, rng.choice([-1, 1]) * out, rng))
        return np.concatenate(parts) if parts else np.empty((0, 3, 3), dtype=np.float32)

    def _moving(
        self, part: Triangles, s: float, lateral: float, rng: np.random.Generator
    ) -> Triangles:
        x, y = self.terrain.xy(np.array(s), np.array(lateral))
        z = float(self.terrain.height(np.array(s), np.array(lateral)))
        yaw = self.terrain.heading(s) + np.pi * (lateral > 0) + rng.normal() * 0.02
        return place(part, x=float(x), y=float(y), z=z, yaw=yaw)
