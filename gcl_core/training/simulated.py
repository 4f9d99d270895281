"""Groups of scans from simulated streets, made anew for every few samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gcl_core import se3
from gcl_core.data.group_index import ScanGroup, between
from gcl_core.data.groups import REACH, draw_neighbors
from gcl_core.data.sequence import positions
from gcl_core.data.simulator.drive import Route
from gcl_core.data.simulator.sequence import SimulatedSequence, World
from gcl_core.errors import GclError

CENTRE_SPAN = 30  # scans, a metre apart, around the middle of a street where centres are taken
INTERLEAVED = 4  # worlds that samples alternate between, so that 2 or 4 workers share none


@dataclass(frozen=True)
class SimulationConfig:
    """What is simulated for training.

    Attributes:
        samples_per_world: samples taken from one street before a new one is built.
        sensors: of the centre scans, one drawn for each sample.
        other_sensor: probability that a neighbour was seen by another of the sensors.
        oncoming: probability that a neighbour was seen from the other lane, driving against.
    """

    samples_per_world: int = 2
    sensors: tuple[str, ...] = ('hdl64e',)
    other_sensor: float = 0.0
    oncoming: float = 0.0

    def __post_init__(self) -> None:
        if not self.sensors:
            raise GclError('simulation.sensors is empty; name at least one')
        if self.samples_per_world < 1:
            raise GclError('simulation.samples_per_world must be at least 1')


@lru_cache(maxsize=INTERLEAVED)
def _world(seed: int) -> World:
    return World(seed)


class SimulatedGroups:
    """Implements `gcl_core.training.samples.Groups`."""

    def __init__(self, config: SimulationConfig, phi: int, reach: float = REACH) -> None:
        self._config, self._phi, self._reach = config, phi, reach
        self._span = 2 * (reach + CENTRE_SPAN)  # metres driven, a scan each

    def group(
        self, number: int, *, seed: int, distances: tuple[float, float] | None = None
    ) -> ScanGroup:
        """Drive through street of sample `number`, see `Groups`."""
        config = self._config
        block = number // (INTERLEAVED * config.samples_per_world)
        world_seed = seed * 1_000_000 + block * INTERLEAVED + number % INTERLEAVED
        world = _world(world_seed)
        rng = np.random.default_rng([seed, number, 8])
        sensor = str(rng.choice(config.sensors))
        own = SimulatedSequence(world_seed, world=world, sensor=sensor, span=self._span)
        middle = len(own) // 2
        centre = int(rng.integers(middle - CENTRE_SPAN, middle + CENTRE_SPAN))
        clouds, poses = [own.scan(centre)], [np.eye(4)]
        T_centre_world = se3.inverse(own.T_world_lidar(centre))
        for index in self._neighbors(own, centre, distances, rng):
            drive, scan = self._seen_by(own, index, sensor, rng)
            clouds.append(drive.scan(scan))
            poses.append(T_centre_world @ drive.T_world_lidar(scan))
        return ScanGroup(tuple(clouds), np.stack(poses), own.name, (centre,))

    def _seen_by(
        self, own: SimulatedSequence, index: int, sensor: str, rng: np.random.Generator
    ) -> tuple[SimulatedSequence, int]:
        """The vehicle that sees the street from about there, and its scan."""
        config = self._config
        others = [name for name in config.sensors if name != sensor]
        if others and rng.random() < config.other_sensor:
            sensor = str(rng.choice(others))
        oncoming = bool(rng.random() < config.oncoming)
        route: Route = 'oncoming' if oncoming else 'along'
        drive = SimulatedSequence(
            own.world.seed, world=own.world, sensor=sensor, route=route, span=self._span
        )
        return drive, len(drive) - 1 - index if oncoming else index

    def _neighbors(
        self,
        drive: SimulatedSequence,
        centre: int,
        distances: tuple[float, float] | None,
        rng: np.random.Generator,
    ) -> list[int]:
        where = positions(drive)
        if distances is None:
            return draw_neighbors(where, centre, self._phi, rng, reach=self._reach)
        return [int(rng.choice(between(where, centre, distances, len(where))))]
