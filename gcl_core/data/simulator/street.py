"""A world that stands still: lots along a road, side streets, what lines the kerb, bridges."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from gcl_core.data.simulator import furniture, vegetation, vehicles
from gcl_core.data.simulator.buildings import house, silhouette
from gcl_core.data.simulator.kinds import kind_of
from gcl_core.data.simulator.lots import STYLES, Lot
from gcl_core.data.simulator.primitives import Triangles, cylinder
from gcl_core.data.simulator.surfaces import NAMES, Soup, soup
from gcl_core.data.simulator.terrain import REACH, Terrain

HALF_VEHICLE = 1.2  # metres to either side of a lane's middle that stay free
HEADROOM = 3.5  # metres above the road


class Street:
    """Static world of one seed.

    Args:
        seed: everything follows from it.
        kind: a name from `kinds.KINDS`; drawn from the seed when None.

    Attributes:
        kind_name: the kind of place it turned out to be.
        kind: what is there in such a place.
        terrain: course of the road and the ground.
        soup: all triangles.
    """

    def __init__(self, seed: int, kind: str | None = None) -> None:
        self.kind_name, self.kind = kind_of(seed, kind)
        rng = np.random.default_rng([seed, 0])
        self.terrain = Terrain(rng, self.kind)
        self._parts: list[Triangles] = []
        self._surfaces: list[int] = []
        self._places: list[tuple[float, float, float]] = []
        self._bridges = self._build_bridge(rng)
        for side in (-1, 1):
            self._build_side(side, rng)
            self._line_kerb(side, rng)
            self._build_background(side, rng)
        self.soup = self._assemble(rng)

    def _put(
        self, part: Triangles, surface: str, s: float, lateral: float, yaw: float = 0.0
    ) -> None:
        """Stand a part on the ground, its -y side towards the road when `yaw` is 0."""
        self._parts.append(part)
        self._surfaces.append(NAMES.index(surface))
        self._places.append((s, lateral, yaw + (0.0 if lateral > 0 else np.pi)))

    def _assemble(self, rng: np.random.Generator) -> Soup:
        """Turn and move all parts at once; drop those that a bend would put on the road."""
        s, lateral, yaw = np.array(self._places).T
        xy, z = self.terrain.xy(s, lateral), self.terrain.height(s, lateral) - 0.05
        turn = self.terrain.heading(s) + yaw
        kept = np.flatnonzero(~self.terrain.folded(s, lateral) & ~self._in_the_way(xy, z, turn))
        parts = [self._parts[i] for i in kept]
        owner = np.repeat(kept, [len(part) for part in parts])
        triangles = move(np.concatenate(parts), owner, np.column_stack([xy, z]), turn)
        ground = self.terrain.mesh(rng)
        surface = [*self._surfaces, NAMES.index('asphalt'), NAMES.index('ground')]
        owners = np.repeat(len(self._surfaces) + np.arange(2), [len(g) for g in ground])
        return soup(
            np.concatenate([triangles, *ground]),
            np.concatenate([owner, owners]),
            np.array(surface),
            rng,
        )

    def _in_the_way(
        self,
        xy: Float[np.ndarray, 'o 2'],
        z: Float[np.ndarray, ' o'],
        turn: Float[np.ndarray, ' o'],
    ) -> Bool[np.ndarray, ' o']:
        """Which parts reach into the lanes below a roof; a bend may put far ones there."""
        terrain = self.terrain
        clear = 0.4 * terrain.half_road + HALF_VEHICLE
        along = np.arange(-REACH, REACH, 1.0)
        road = terrain.xy(along, np.zeros_like(along))
        height = terrain.height(along, np.zeros_like(along))
        tree = cKDTree(road)
        away, _ = tree.query(xy)
        found = np.zeros(len(xy), dtype=bool)
        for i, part in enumerate(self._parts):
            corners = part.reshape(-1, 3)
            if away[i] > clear + np.abs(corners[:, :2]).max() * np.sqrt(2):
                continue
            middles = (part + np.roll(part, 1, axis=1)).reshape(-1, 3) / 2
            points = np.concatenate([corners, middles, part.mean(1)])
            c, s = np.cos(turn[i]), np.sin(turn[i])
            moved = xy[i] + points[:, :2] @ np.array([[c, s], [-s, c]])
            distance, nearest = tree.query(moved, distance_upper_bound=clear)
            hit = np.isfinite(distance)
            low = z[i] + points[hit, 2] < height[nearest[hit]] + HEADROOM
            found[i] = bool(low.any())
        return found

    def blocked(self, s: float, margin: float) -> bool:
        """Whether a side street or a bridge takes this place along the road."""
        at_bridge = any(abs(s - middle) < half + margin for middle, half in self._bridges)
        return at_bridge or bool(self.terrain.in_crossing(np.array(s), margin=margin))

    def _build_bridge(self, rng: np.random.Generator) -> list[tuple[float, float]]:
        """Perhaps a bridge over the road; returns (middle, half its length)."""
        bridges: list[tuple[float, float]] = []
        middle, length = rng.uniform(-70, 70), rng.uniform(6, 22)
        crossing = bool(self.terrain.in_crossing(np.array(middle), margin=length / 2 + 2))
        if rng.random() < self.kind.bridge and not crossing:
            clear = self.terrain.half_road + self.terrain.sidewalk + rng.uniform(0.3, 4.0)
            part = furniture.bridge(clear, length, rng)
            self._put(part, 'facade', middle, 0.0)
            bridges.append((middle, length / 2))
        return bridges

    def _build_side(self, side: int, rng: np.random.Generator) -> None:
        """Fill one side of the road, lot after lot, changing style now and then."""
        edge = self.terrain.half_road + self.terrain.sidewalk
        names, shares = list(self.kind.styles), np.array(list(self.kind.styles.values()))
        s, style, style_end = -REACH, names[0], -np.inf
        while s < REACH:
            if s > style_end:
                style = str(rng.choice(names, p=shares / shares.sum()))
                style_end = s + rng.uniform(50, 200)
            length = rng.uniform(*STYLES[style].length)
            middle = s + length / 2
            if not self.blocked(middle, length / 2):
                self._fill_lot(style, middle, length, side, rng)
            elif self.terrain.in_crossing(np.array(middle), margin=length / 2):
                self._fill_corner(middle, side, edge, rng)
            s += length

    def _fill_lot(
        self, style: str, s: float, length: float, side: int, rng: np.random.Generator
    ) -> None:
        edge = self.terrain.half_road + self.terrain.sidewalk

        def put(part: Triangles, surface: str, along: float, out: float, yaw: float) -> None:
            self._put(part, surface, s + along, side * (edge + out), yaw)

        STYLES[style].fill(Lot(put, length, rng))

    def _fill_corner(self, s: float, side: int, edge: float, rng: np.random.Generator) -> None:
        """Line a side street with houses that face it, and a few trees."""
        middle, half = min(self.terrain.crossings, key=lambda c: abs(c[0] - s))
        built = self.kind.side_streets
        for direction in (-1, 1):
            out = edge + rng.uniform(4, 14)
            while out < 75:
                width = rng.uniform(8, 14)
                offset = half + rng.uniform(3, 7) + width / 2
                if rng.random() < built:
                    part = house(rng.uniform(8, 14), width, rng.uniform(*self.kind.storeys), rng)
                    # On either side of the road, the front turns to the side street.
                    yaw = -direction * side * np.pi / 2
                    self._put(part, 'facade', middle + direction * offset, side * out, yaw)
                else:
                    self._put(
                        vegetation.tree(rng, detail=0.5),
                        'leaf',
                        middle + direction * offset,
                        side * out,
                    )
                if half > 4.5 and rng.random() < 0.4 * built:
                    kerb = middle + direction * (half - 0.8)
                    self._put(vehicles.car(rng), 'paint', kerb, side * out, np.pi / 2)
                out += rng.uniform(14, 22)

    def _build_background(self, side: int, rng: np.random.Generator) -> None:
        """Buildings and trees 45 to 85 m from the road, seen through gaps."""
        s = -REACH
        while s < REACH:
            s += rng.uniform(12, 25)
            lateral = side * rng.uniform(45, 85)
            if bool(self.terrain.in_crossing(np.array(s), margin=8.0)):
                continue
            if rng.random() < self.kind.background:
                width, height = rng.uniform(8, 14), rng.uniform(*self.kind.storeys) + 2.0
                part = silhouette(rng.uniform(8, 20), width, height, rng)
                self._put(part, 'facade', s, lateral, rng.normal() * 0.1)
            else:
                self._put(vegetation.tree(rng, detail=0.3), 'leaf', s, lateral)

    def _line_kerb(self, side: int, rng: np.random.Generator) -> None:
        """Parked cars, lamps, signs, street trees and clutter along the kerb."""
        w, parked = self.terrain.half_road, rng.uniform(0, self.kind.parked)
        trees = rng.uniform(0, self.kind.street_trees)
        self._set_bollards(side, rng)
        s = -REACH
        while s < REACH:
            s += rng.uniform(5.5, 8.0)
            if self.blocked(s, 4.0):
                continue
            if rng.random() < parked:
                yaw = rng.normal() * 0.03 + np.pi * rng.integers(0, 2)
                part = vehicles.road_vehicle(rng, trucks=0.03)
                self._put(
                    part, 'paint', s, side * self.terrain.parking(rng.uniform(0.6, 1.2)), yaw
                )
            if rng.random() < 0.12:
                self._put(furniture.lamp(rng), 'metal', s + 2.0, side * (w + 0.5), -np.pi / 2)
            if rng.random() < 0.1:
                self._put(furniture.sign(rng), 'sign', s + 2.5, side * (w + 0.5), -np.pi / 2)
            if rng.random() < trees:
                part = vegetation.tree(rng, roadside=True)
                self._put(part, 'leaf', s + rng.normal(), side * (w + 0.9))
            if rng.random() < 0.2:
                out = w + rng.uniform(0.4, max(1.0, self.terrain.sidewalk))
                self._put(furniture.clutter(rng), 'metal', s + rng.normal(), side * out)

    def _set_bollards(self, side: int, rng: np.random.Generator) -> None:
        """Rows of posts along some stretches of the kerb."""
        for _ in range(rng.poisson(2.0) if self.kind.people > 2 else 0):
            start, pitch = rng.uniform(-REACH, REACH), rng.uniform(1.2, 4.0)
            part = cylinder(rng.uniform(0.05, 0.15), rng.uniform(0.6, 1.2), sides=5)
            for s in start + pitch * np.arange(rng.integers(4, 20)):
                if not self.blocked(float(s), 2.0):
                    lateral = side * (self.terrain.half_road + 0.35)
                    self._put(part, 'metal', float(s), lateral)


def move(
    triangles: Triangles,
    owner: np.ndarray,
    xyz: Float[np.ndarray, 'o 3'],
    yaw: Float[np.ndarray, ' o'],
) -> Triangles:
    """Turn each triangle about z by its owner's yaw, then move it to its owner's place."""
    cos, sin = (f(yaw).astype(np.float32)[owner, None] for f in (np.cos, np.sin))
    shift = xyz.astype(np.float32)[owner, None]
    x, y = triangles[..., 0], triangles[..., 1]
    turned = np.stack([cos * x - sin * y, sin * x + cos * y, triangles[..., 2]], -1)
    return turned + shift
