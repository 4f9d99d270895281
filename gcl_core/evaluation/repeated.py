"""Streets of one house over and over: where a wrong place looks like the right one."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.simulator.buildings import house
from gcl_core.data.simulator.casting import Scene
from gcl_core.data.simulator.furniture import lamp
from gcl_core.data.simulator.primitives import Triangles, box, place
from gcl_core.data.simulator.returns import draw_conditions
from gcl_core.data.simulator.sensors import sensor_named
from gcl_core.data.simulator.surfaces import NAMES, soup
from gcl_core.data.simulator.sweep import sweep
from gcl_core.data.simulator.traffic import Moment, body, joined
from gcl_core.data.simulator.vehicles import car
from gcl_core.types import PointCloud

REACH = 150.0  # metres of street to either side of the middle
PARALLEL = 60.0  # metres between the two streets
HALF_ROAD = 7.0  # metres from the middle of the road to the fences


class RepeatedSequence:
    """Two parallel streets with the same houses at the same spacing; a scan every metre of both.

    Implements `gcl_core.data.sequence.Sequence`: the first half of the scans is on one street, the
    second half on the other. A lamp or a parked car here and there is all that tells places apart.
    """

    def __init__(self, seed: int, *, span: float = 130.0, sensor: str = 'hdl64e') -> None:
        self.name = f'repeated/{seed}'
        self._seed, self._sensor = seed, sensor_named(sensor)
        self._s = np.arange(-span / 2, span / 2 + 1e-6, 1.0)

    def __len__(self) -> int:
        return 2 * len(self._s)

    @cached_property
    def _scene(self) -> Scene:
        rng = np.random.default_rng([self._seed, 0])
        pitch, length, width = rng.uniform(9, 24), rng.uniform(7, 16), rng.uniform(7, 12)
        height, setback = rng.uniform(3, 9), rng.uniform(1, 6)
        part = house(min(length, 0.85 * pitch), width, height, rng)
        ground = place(box(6 * REACH, 6 * REACH, 0.1), z=-0.1)
        parts: list[Triangles] = [ground]
        for middle in (0.0, PARALLEL):
            for side in (-1, 1):
                y = middle + side * (HALF_ROAD + setback + width / 2)
                turn = 0.0 if side > 0 else np.pi
                parts += [place(part, x=x, y=y, yaw=turn) for x in np.arange(-REACH, REACH, pitch)]
            parts += self._things(middle, rng)
        owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        surface = np.full(len(parts), NAMES.index('facade'))
        return Scene(soup(np.concatenate(parts), owner, surface, rng))

    @staticmethod
    def _things(middle: float, rng: np.random.Generator) -> list[Triangles]:
        """What differs from lot to lot; often nothing."""
        things = []
        for _ in range(rng.integers(0, 12)):
            part = car(rng) if rng.random() < 0.5 else lamp(rng)
            y = middle + rng.choice([-1, 1]) * (HALF_ROAD - 1.5)
            things.append(place(part, x=rng.uniform(-REACH, REACH), y=y))
        return things

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose on the right-hand lane of either street."""
        street, place_ = divmod(index, len(self._s))
        rng = np.random.default_rng([self._seed, 2, index])
        return se3.from_xyz_rpy(
            x=float(self._s[place_]),
            y=street * PARALLEL - 2.0 + rng.normal() * 0.3,
            z=1.8,
            roll=rng.normal() * 0.006,
            pitch=rng.normal() * 0.006,
            yaw=rng.normal() * 0.02,
        )

    def scan(self, index: int) -> PointCloud:
        """Cast one turn of the sensor."""
        rng = np.random.default_rng([self._seed, 3, index])
        conditions = draw_conditions(self._sensor, np.random.default_rng([self._seed, 4]))
        still = np.zeros(2)
        pose = self.T_world_lidar(index)
        traffic = self._traffic(pose, rng)
        return sweep(self._sensor, self._scene, traffic, pose, still, conditions, rng)

    @staticmethod
    def _traffic(pose: Float[np.ndarray, '4 4'], rng: np.random.Generator) -> Moment | None:
        """Cars that are elsewhere in the next scan: right places have conflicts as well."""
        cars = []
        for _ in range(rng.integers(0, 5)):
            x, y = pose[:2, 3]
            way = int(rng.choice([-1, 1]))
            ahead = x + rng.choice([-1, 1]) * rng.uniform(9.0, 60.0)
            place_ = np.array([ahead, y + (4.0 if way < 0 else 0.0), 0.0])
            cars.append(body(rng, place_, 0.0 if way > 0 else np.pi, rng.uniform(4, 13)))
        return joined(cars) if cars else None
