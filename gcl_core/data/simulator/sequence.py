"""A drive through a simulated street."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.simulator.sensors import Scene, scan, sensor_named
from gcl_core.data.simulator.street import Street
from gcl_core.types import PointCloud

SENSOR_HEIGHT = 1.73  # metres, KITTI's car


class SimulatedSequence:
    """Implements `gcl_core.data.sequence.Sequence`; everything follows from the seed.

    Args:
        seed: of the world and of every scan in it.
        sensor: a name from `gcl_core.data.simulator.sensors.SENSORS`.
        span: metres driven, centred on the middle of the street.
        spacing: metres between scans.
        oncoming: drive the other way on the other lane. The same seed gives the same world, so
            that two vehicles can meet in it.
    """

    def __init__(
        self,
        seed: int,
        *,
        sensor: str = 'hdl64e',
        span: float = 180.0,
        spacing: float = 1.0,
        oncoming: bool = False,
    ) -> None:
        self.name = f'sim/{seed}'
        self._seed = seed
        self._sensor = sensor_named(sensor)
        self._oncoming = oncoming
        self._s = np.arange(-span / 2, span / 2 + 1e-6, spacing)
        if oncoming:
            self._s = self._s[::-1]
        rng = np.random.default_rng([seed, 1, int(oncoming)])
        self._height = SENSOR_HEIGHT + rng.uniform(-0.15, 0.25)
        self._sway = rng.uniform(0.2, 1.0), rng.uniform(40, 120), rng.uniform(0, 2 * np.pi)

    def __len__(self) -> int:
        return len(self._s)

    @cached_property
    def street(self) -> Street:
        """The world, built when first needed."""
        return Street(self._seed)

    @cached_property
    def _static(self) -> Scene:
        return Scene(self.street.triangles)

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose on the right-hand lane, following the road with a little sway and pitch."""
        terrain, s = self.street.terrain, float(self._s[index])
        direction = -1.0 if self._oncoming else 1.0
        amplitude, period, phase = self._sway
        wave = 2 * np.pi * s / period + phase
        lateral = -direction * 0.4 * terrain.half_road + amplitude * np.sin(wave)
        ahead = np.array([s + direction, s - direction])
        front, rear = terrain.height(ahead, np.array([lateral, lateral]))
        rng = np.random.default_rng([self._seed, 2, index])
        x, y = terrain.xy(np.array(s), np.array(lateral))
        ground = float(terrain.height(np.array(s), np.array(lateral)))
        sway = direction * np.arctan(amplitude * np.cos(wave) * 2 * np.pi / period)
        return se3.from_xyz_rpy(
            x=float(x),
            y=float(y),
            z=ground + self._height,
            roll=rng.normal() * 0.006,
            pitch=-np.arctan2(front - rear, 2.0) + rng.normal() * 0.006,
            yaw=terrain.heading(s) + (np.pi if self._oncoming else 0.0) + float(sway),
        )

    def scan(self, index: int) -> PointCloud:
        """Cast one turn of the sensor, with that moment's traffic."""
        rng = np.random.default_rng([self._seed, 3, index, int(self._oncoming)])
        scenes = [self._static]
        traffic = self.street.traffic(rng, float(self._s[index]))
        if len(traffic):
            scenes.append(Scene(traffic))
        return scan(self._sensor, scenes, self.T_world_lidar(index), rng)
