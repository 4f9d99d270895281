"""What moves: vehicles in their lanes, on side streets, people on pavements, by one clock.

All vehicles of a direction drive at that direction's speed, the ones with a LiDAR among them, so
that none runs into another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcl_core.data.simulator import vehicles
from gcl_core.data.simulator.primitives import Triangles
from gcl_core.data.simulator.street import Street, move
from gcl_core.data.simulator.surfaces import NAMES, Soup, soup
from gcl_core.data.simulator.terrain import REACH

SIDE_REACH = 70.0  # metres that traffic on a side street is followed
# Metres between a road user's middle and a sensor's vehicle, along and across its course, that
# stay free; the last where courses cross.
CLEAR_AHEAD, CLEAR_BESIDE, CLEAR_CROSSING = 9.0, 1.9, 4.5


@dataclass(frozen=True)
class Moment:
    """Traffic at one moment.

    Attributes:
        soup: triangles, world frame.
        owner: which road user each triangle belongs to.
        velocity: of each road user, metres per second, world frame.
    """

    soup: Soup
    owner: np.ndarray
    velocity: Float[np.ndarray, 'o 3']


class Traffic:
    """Road users of one street as a function of time.

    Args:
        street: the world they move in.
        seed: decides who moves where.

    Attributes:
        lane_speed: metres per second along and against the road.
    """

    def __init__(self, street: Street, seed: int) -> None:
        self._terrain = street.terrain
        rng = np.random.default_rng([seed, 4])
        along = float(
            rng.uniform(8.0, 18.0) if street.kind_name == 'rural' else rng.uniform(4, 13)
        )
        self.lane_speed = along, along * float(rng.uniform(0.7, 1.4))
        self._parts: list[Triangles] = []
        self._surface: list[int] = []
        self._rows: list[tuple[float, float, float, float]] = []  # s, lateral and their rates
        self._fill_lanes(rng.poisson(street.kind.vehicles), rng)
        self._fill_side_streets(street.kind.vehicles, rng)
        self._fill_pavements(rng.poisson(street.kind.people), rng)
        owner = np.repeat(np.arange(len(self._parts)), [len(part) for part in self._parts])
        joined = np.concatenate([np.empty((0, 3, 3), np.float32), *self._parts])
        self._soup = soup(joined, owner, np.array(self._surface, dtype=int), rng)
        self._owner = owner
        self._motion = np.array(self._rows).reshape(-1, 4)

    def _add(self, part: Triangles, surface: str, row: tuple[float, float, float, float]) -> None:
        self._parts.append(part)
        self._surface.append(NAMES.index(surface))
        self._rows.append(row)

    def _fill_lanes(self, count: int, rng: np.random.Generator) -> None:
        """Vehicles in slots 16 m apart; slot 0, where sensors drive, stays free."""
        slots = rng.permutation(np.arange(-11, 12))[:count]
        for slot in slots[slots != 0]:
            way = int(rng.choice([-1, 1]))
            s, lane = 16.0 * slot + rng.uniform(-1.5, 1.5), -way * 0.45 * self._terrain.half_road
            speed = self.lane_speed[0 if way > 0 else 1] if rng.random() < 0.85 else 0.0
            if speed == 0.0:  # stopped at the kerb
                lane = -way * self._terrain.parking(0.9)
            row = (float(s), lane + rng.normal() * 0.15, way * speed, 0.0)
            self._add(vehicles.road_vehicle(rng), 'paint', row)

    def _fill_side_streets(self, vehicles_per_road: float, rng: np.random.Generator) -> None:
        for middle, half in self._terrain.crossings:
            for _ in range(rng.poisson(0.08 * vehicles_per_road)):
                way = int(rng.choice([-1, 1]))
                s = middle + way * 0.4 * half
                row = (s, float(rng.uniform(-1, 1) * SIDE_REACH), 0.0, way * rng.uniform(3, 10))
                self._add(vehicles.road_vehicle(rng), 'paint', row)

    def _fill_pavements(self, count: int, rng: np.random.Generator) -> None:
        for _ in range(count):
            side, cycling = int(rng.choice([-1, 1])), rng.random() < 0.3
            way = -side if cycling else int(rng.choice([-1, 1]))
            out = rng.uniform(-1.2, -0.4) if cycling else rng.uniform(0.3, 3.0)
            lateral = side * (self._terrain.half_road + out)
            speed = rng.uniform(3, 7) if cycling else rng.uniform(0, 1.8)
            part = vehicles.cyclist(rng) if cycling else vehicles.person(rng)
            self._add(part, 'cloth', (rng.uniform(-REACH, REACH), lateral, way * speed, 0.0))

    def _clear(
        self,
        offset: Float[np.ndarray, 'o v 3'],
        yaw: Float[np.ndarray, ' o'],
        crossing: np.ndarray,
    ) -> np.ndarray:
        """Whether each road user is out of every sensor's way, and near enough to be seen."""
        cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        ahead = np.abs(cos * offset[..., 0] + sin * offset[..., 1])
        beside = np.abs(cos * offset[..., 1] - sin * offset[..., 0])
        width = np.where(crossing, CLEAR_CROSSING, CLEAR_BESIDE)[:, None]
        free = (ahead > CLEAR_AHEAD) | (beside > width)
        return np.asarray(free.all(1) & (np.hypot(ahead, beside) < 90.0).any(1))

    def at(self, time: float, clear: Float[np.ndarray, 'v 3'], *, crossing: bool) -> Moment:
        """Everybody's place at `time` seconds, without who is too near to a sensor's vehicle.

        Args:
            time: seconds; 0 is the middle of the drives.
            clear: positions of the vehicles that carry sensors, metres, world frame.
            crossing: whether such a vehicle leaves its lane, so that all others keep away.
        """
        s, lateral, s_rate, lateral_rate = self._motion.T
        s = (s + s_rate * time + REACH) % (2 * REACH) - REACH
        across = lateral_rate != 0
        wrapped = (lateral + lateral_rate * time + SIDE_REACH) % (2 * SIDE_REACH) - SIDE_REACH
        lateral = np.where(across, wrapped, lateral)
        terrain = self._terrain
        xyz = np.column_stack([terrain.xy(s, lateral), terrain.height(s, lateral)])
        heading = terrain.heading(s)
        course = np.where(s_rate < 0, np.pi, 0.0) + np.sign(lateral_rate) * np.pi / 2
        yaw = heading + course
        speed = np.hypot(s_rate, lateral_rate)
        velocity = np.column_stack([np.cos(yaw) * speed, np.sin(yaw) * speed, 0 * yaw])
        kept = self._clear(clear - xyz[:, None], yaw, across | crossing)
        mask = kept[self._owner]
        owner = self._owner[mask]
        return Moment(
            Soup(
                move(self._soup.triangles[mask], owner, xyz, yaw),
                self._soup.reflectance[mask],
                self._soup.depth[mask],
            ),
            owner,
            velocity,
        )


def body(
    rng: np.random.Generator, xyz: Float[np.ndarray, '3'], yaw: float, speed: float
) -> Moment:
    """A vehicle that carries a sensor, as others see it."""
    part = vehicles.car(rng)
    owner = np.zeros(len(part), dtype=int)
    place = move(part, owner, xyz[None], np.array([yaw]))
    velocity = speed * np.array([[np.cos(yaw), np.sin(yaw), 0.0]])
    return Moment(soup(place, owner, np.array([NAMES.index('paint')]), rng), owner, velocity)


def joined(moments: list[Moment]) -> Moment:
    """All road users of several moments in one."""
    first = np.cumsum([0] + [len(m.velocity) for m in moments[:-1]])
    soups = [m.soup for m in moments]
    return Moment(
        Soup(
            np.concatenate([s.triangles for s in soups]),
            np.concatenate([s.reflectance for s in soups]),
            np.concatenate([s.depth for s in soups]),
        ),
        np.concatenate([m.owner + start for m, start in zip(moments, first, strict=True)]),
        np.concatenate([m.velocity for m in moments]),
    )
