"""A drive through a simulated street."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float

from gcl_core.data.simulator.casting import Scene
from gcl_core.data.simulator.drive import Drive, Route, course, route_number
from gcl_core.data.simulator.returns import Conditions, draw_conditions
from gcl_core.data.simulator.sensors import sensor_named
from gcl_core.data.simulator.street import Street
from gcl_core.data.simulator.sweep import sweep
from gcl_core.data.simulator.traffic import Moment, Traffic, body, joined
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

MIN_SPACING = 1e-3  # metres between scans; 180,000 of them in a drive


class World:
    """A street, its traffic and what beams are cast at, shared by the vehicles in it.

    Args:
        seed: everything follows from it.
        kind: a name from `kinds.KINDS`; drawn from the seed when None.
    """

    def __init__(self, seed: int, kind: str | None = None) -> None:
        self.seed = seed
        self.street = Street(seed, kind)
        self.scene = Scene(self.street.soup)
        self.traffic = Traffic(self.street, seed)


class SimulatedSequence:
    """Implements `gcl_core.data.sequence.Sequence`; everything follows from the seed.

    Args:
        seed: of the world and of every scan in it.
        sensor: a name from `gcl_core.data.simulator.sensors.SENSORS`.
        span: metres driven, centred on the middle of the route.
        spacing: metres between scans, a millimetre to half the span.
        route: where in the street to drive. The same seed gives the same world and the same
            clock, so that two vehicles can meet in it.
        lead: metres to start ahead of the middle.
        kind: kind of place, from `kinds.KINDS`; drawn from the seed when None.
        world: a world to share instead of building one; `seed` and `kind` then have no effect
            on it.
        moving: whether anything moves but the vehicle itself.
        conditions: noise, losses, de-skewing; drawn from the seed when None.

    Raises:
        GclError: spacing out of its bounds, no such sensor.
    """

    def __init__(
        self,
        seed: int,
        *,
        sensor: str = 'hdl64e',
        span: float = 180.0,
        spacing: float = 1.0,
        route: Route = 'along',
        lead: float = 0.0,
        kind: str | None = None,
        world: World | None = None,
        moving: bool = True,
        conditions: Conditions | None = None,
    ) -> None:
        if not MIN_SPACING <= spacing <= span / 2:
            raise GclError(f'spacing is {spacing:g} m; it must be {MIN_SPACING:g} to {span / 2:g}')
        self.name = f'sim/{seed}'
        self._seed, self._kind, self._world = seed, kind, world
        self._sensor = sensor_named(sensor)
        self._route: Route = route
        self._travelled = np.arange(-span / 2, span / 2 + 1e-6, spacing)
        self._lead, self._moving = lead, moving
        # What is the vehicle's own differs between the vehicles of a world.
        self._own = [seed, route_number(self._route), round(lead * 10) % 10_000]
        rng = np.random.default_rng([*self._own, 5])
        self.conditions = conditions or draw_conditions(self._sensor, rng)
        self.others: tuple[SimulatedSequence, ...] = ()  # in the same world, seen and avoided

    def __len__(self) -> int:
        return len(self._travelled)

    @cached_property
    def world(self) -> World:
        """The world, built when first needed."""
        return self._world or World(self._seed, self._kind)

    @cached_property
    def _drive(self) -> Drive:
        terrain = self.world.street.terrain
        where = course(self._route, terrain, self._travelled + self._lead)
        return Drive(terrain, where, self._times, np.random.default_rng([*self._own, 1]))

    @cached_property
    def _times(self) -> Float[np.ndarray, ' n']:
        """Seconds of the world's clock; 0 in the middle of the drive."""
        along, against = self.world.traffic.lane_speed
        return self._travelled / (against if self._route == 'oncoming' else along)

    def stamp(self, index: int) -> float:
        """Seconds since the first scan."""
        return float(self._times[index] - self._times[0])

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose in the middle of a scan: on the right-hand lane, with sway, roll and pitch."""
        return np.asarray(self._drive.poses[index])

    def _ground(self, time: float) -> tuple[Float[np.ndarray, '3'], float, float]:
        """Place on the ground, heading and speed at a time of the world's clock."""
        drive, times = self._drive, self._times
        xyz = [np.interp(time, times, drive.ground[:, axis]) for axis in range(3)]
        nearest = int(np.abs(times - time).argmin())
        yaw = float(np.interp(time, times, drive.ground[:, 3]))
        return np.array(xyz), yaw, float(drive.twist[nearest, 0])

    def _moment(self, index: int) -> Moment:
        """Traffic, and the other vehicles of this world, in the middle of a scan."""
        time = float(self._times[index])
        places = [other._ground(time) for other in (self, *self.others)]
        crossing = any(v._route in ('across', 'turning') for v in (self, *self.others))
        clear = np.array([xyz for xyz, _, _ in places])
        moments = [self.world.traffic.at(time, clear, crossing=crossing)]
        for other, (xyz, yaw, speed) in zip(self.others, places[1:], strict=True):
            moments.append(body(np.random.default_rng([*other._own, 6]), xyz, yaw, speed))
        return joined(moments)

    def scan(self, index: int) -> PointCloud:
        """Cast one sweep, with that moment's traffic."""
        rng = np.random.default_rng([*self._own, 3, index % len(self)])
        return sweep(
            self._sensor,
            self.world.scene,
            self._moment(index) if self._moving else None,
            self._drive.poses[index],
            self._drive.twist[index],
            self.conditions,
            rng,
        )
