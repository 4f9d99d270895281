"""Places with nothing to hold on to: a tunnel, an empty field."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.simulator.casting import Scene
from gcl_core.data.simulator.primitives import Triangles, box, place, quad
from gcl_core.data.simulator.returns import draw_conditions
from gcl_core.data.simulator.sensors import sensor_named
from gcl_core.data.simulator.surfaces import NAMES, soup
from gcl_core.data.simulator.sweep import sweep
from gcl_core.types import PointCloud

REACH = 250.0  # metres to either side of the middle: farther than a sensor sees


class BarrenSequence:
    """A scan every metre along x. Implements `gcl_core.data.sequence.Sequence`.

    Args:
        seed: decides on the place and its scans.
        kind: `tunnel` (walls, a vault, a lamp at every same distance, nothing else) or `field`
            (ground with furrows, nothing higher than they are).
        span: metres driven.
        sensor: as in `SimulatedSequence`.
    """

    def __init__(
        self, seed: int, kind: str, *, span: float = 130.0, sensor: str = 'hdl64e'
    ) -> None:
        self.name, self._kind = f'{kind}/{seed}', kind
        self._seed, self._sensor = seed, sensor_named(sensor)
        self._s = np.arange(-span / 2, span / 2 + 1e-6, 1.0)

    def __len__(self) -> int:
        return len(self._s)

    @cached_property
    def _scene(self) -> Scene:
        rng = np.random.default_rng([self._seed, 0])
        parts = tunnel(rng) if self._kind == 'tunnel' else field(rng)
        owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        surface = np.full(
            len(parts), NAMES.index('facade' if self._kind == 'tunnel' else 'ground')
        )
        return Scene(soup(np.concatenate(parts), owner, surface, rng))

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose in the right-hand lane."""
        rng = np.random.default_rng([self._seed, 2, index])
        roll, pitch = rng.normal(size=2) * 0.006
        x, y = float(self._s[index]), -2.0 + rng.normal() * 0.3
        return se3.from_xyz_rpy(x=x, y=y, z=1.8, roll=roll, pitch=pitch, yaw=rng.normal() * 0.02)

    def scan(self, index: int) -> PointCloud:
        """Cast one turn of the sensor."""
        rng = np.random.default_rng([self._seed, 3, index])
        conditions = draw_conditions(self._sensor, np.random.default_rng([self._seed, 4]))
        pose = self.T_world_lidar(index)
        return sweep(self._sensor, self._scene, None, pose, np.zeros(2), conditions, rng)


def tunnel(rng: np.random.Generator) -> list[Triangles]:
    """Road, an arched shell along x, lamps under its top."""
    half, rise = rng.uniform(4.5, 7.0), rng.uniform(4.8, 6.5)
    angle = np.linspace(0, np.pi, 17)
    y, z = half * np.cos(angle), rise * np.sin(angle) ** 0.6
    ends = [np.column_stack([np.full(17, x), y, z]) for x in (-REACH, REACH)]
    shell = quad(ends[0][:-1], ends[0][1:], ends[1][1:], ends[1][:-1])
    ground = place(box(2 * REACH, 2 * half, 0.1), z=-0.1)
    spacing = rng.uniform(6, 20)
    lamps = [
        place(box(1.2, 0.3, 0.2), x=x, z=rise - 0.4) for x in np.arange(-REACH, REACH, spacing)
    ]
    return [ground, shell, *lamps]


def field(rng: np.random.Generator) -> list[Triangles]:
    """Flat ground with furrows across the way."""
    ground = place(box(2 * REACH, 2 * REACH, 0.1), z=-0.1)
    spacing, height = rng.uniform(3, 12), rng.uniform(0.05, 0.3)
    x = (
        np.arange(-REACH, REACH, spacing)
        + rng.normal(size=int(np.ceil(2 * REACH / spacing))) * 0.3
    )
    return [ground, *(place(box(0.6, 2 * REACH, height), x=at) for at in x)]
