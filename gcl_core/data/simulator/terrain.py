"""The road's course and the ground around it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from gcl_core.data.simulator.kinds import Kind
from gcl_core.data.simulator.primitives import Triangles, quad

REACH = 190.0  # metres of street on either side of its middle
LATERAL_REACH = 90.0  # metres of ground on either side of the road


class Terrain:
    """Maps street coordinates (s along, l to the left of the centre line) to the world.

    Attributes:
        half_road: half the width of the roadway, metres.
        sidewalk: width of the pavement on either side, metres.
        crossings: (middle, half width) along s of the side streets, metres.
    """

    def __init__(self, rng: np.random.Generator, kind: Kind) -> None:
        self.half_road = rng.uniform(*kind.half_road)
        self.sidewalk = rng.uniform(*kind.sidewalk)
        self.kerb = rng.uniform(0.06, 0.18) if self.sidewalk else -rng.uniform(0.05, 0.5)
        self.crossings: list[tuple[float, float]] = []
        s = -REACH + rng.uniform(0, 120)
        while s < REACH:
            self.crossings.append((float(s), float(rng.uniform(3.0, 8.0))))
            s += rng.uniform(*kind.crossings)

        self._s = np.arange(-REACH - 20, REACH + 21, 1.0)
        bend = np.zeros_like(self._s)
        for _ in range(3):
            period, phase = rng.uniform(150, 500), rng.uniform(0, 2 * np.pi)
            bend += rng.normal() * 0.25 * kind.bend * np.sin(2 * np.pi * self._s / period + phase)
        bend = 1.4 * np.tanh(bend / 1.4)
        self._heading = bend - np.interp(0.0, self._s, bend)
        step = np.stack([np.cos(self._heading), np.sin(self._heading)], 1)
        self._line = np.cumsum(step, 0)
        self._line -= self._line[len(self._s) // 2]

        self._waves = [
            (
                rng.normal() * a * h,
                2 * np.pi / rng.uniform(p, 3 * p),
                *rng.uniform(0, 2 * np.pi, 2),
            )
            for a, p, h in ((1.2, 120.0, kind.hills), (0.35, 50.0, 1.0), (0.08, 15.0, 1.0))
        ]
        self._slope = rng.normal(size=2) * 0.012 * kind.hills
        self._bank = rng.normal(size=2) * 0.9 * (rng.random(2) < 0.5)

        self._tree = cKDTree(self._line)

    def heading(self, s: np.ndarray) -> Float[np.ndarray, '*n']:
        """Direction of the road at s, radians from world x."""
        return np.interp(s, self._s, self._heading)

    def folded(self, s: np.ndarray, lateral: np.ndarray) -> np.ndarray:
        """Whether a bend brings the place nearer to another stretch of the road."""
        distance, _ = self._tree.query(self.xy(s, lateral))
        return np.asarray(distance < np.abs(lateral) - 0.7)

    def xy(self, s: np.ndarray, lateral: np.ndarray) -> Float[np.ndarray, '*n 2']:
        """World x, y of street coordinates."""
        x, y, h = (
            np.interp(s, self._s, column)
            for column in (self._line[:, 0], self._line[:, 1], self._heading)
        )
        return np.stack([x - np.sin(h) * lateral, y + np.cos(h) * lateral], -1)

    def parking(self, inside: float) -> float:
        """Lateral place of a vehicle parked `inside` metres from the kerb, clear of the lane."""
        return float(max(self.half_road - inside, 0.4 * self.half_road + 2.7))

    def in_crossing(self, s: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """Whether s lies within a side street."""
        inside = np.zeros(np.shape(s), dtype=bool)
        for middle, half in self.crossings:
            inside |= np.abs(s - middle) < half + margin
        return inside

    def height(self, s: np.ndarray, lateral: np.ndarray) -> np.ndarray:
        """Ground height: hills, camber, kerbs, banks behind the pavement."""
        xy = self.xy(s, lateral)
        z = xy @ self._slope
        for amplitude, frequency, direction, phase in self._waves:
            along = xy[..., 0] * np.cos(direction) + xy[..., 1] * np.sin(direction)
            z = z + amplitude * np.sin(frequency * along + phase)
        outside = np.abs(lateral) - self.half_road
        flat = self.in_crossing(s)
        z = z - 0.02 * np.clip(outside + self.half_road, 0, self.half_road)
        z = z + np.where((outside > 0.03) & ~flat, self.kerb, 0.0)
        bank = np.where(lateral > 0, self._bank[0], self._bank[1])
        rise = np.clip((outside - self.sidewalk) / 4.0, 0.0, 1.0)
        return np.asarray(z + np.where(flat, 0.0, bank * rise))

    def mesh(self, rng: np.random.Generator) -> tuple[Triangles, Triangles]:
        """Asphalt and soil as a strip along the road, finest where kerbs and lawns are."""
        w, p = self.half_road, self.half_road + self.sidewalk
        side = [0.5 * w, w, w + 0.06, w + 0.6 * self.sidewalk, p, p + 0.5, p + 1.5, p + 3, p + 5]
        side += [p + 8, p + 12, p + 17, p + 24, p + 34, p + 48, LATERAL_REACH]
        lateral = np.array([-v for v in side[::-1]] + [0.0] + side)
        s = np.arange(-REACH, REACH + 1, 1.0)
        S, L = np.meshgrid(s, lateral, indexing='ij')
        z = self.height(S, L)
        z += rng.normal(size=z.shape) * np.where(np.abs(L) > p, rng.uniform(0.01, 0.07), 0.006)
        z -= 1.5 * self.folded(S, L)  # below the ground that belongs to the nearer stretch
        xyz = np.concatenate([self.xy(S, L), z[..., None]], -1)
        paved = (np.abs(lateral[:-1] + lateral[1:]) < 2 * p) | self.in_crossing(s[:-1, None])
        corners = (xyz[:-1, :-1], xyz[1:, :-1], xyz[1:, 1:], xyz[:-1, 1:])

        def part(mask: np.ndarray) -> Triangles:
            return quad(*(corner[mask] for corner in corners))

        return part(paved), part(~paved)
