"""Where a vehicle drives in a street, and how its body sways: poses of its sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.simulator.terrain import Terrain
from gcl_core.errors import GclError

Route = Literal['along', 'oncoming', 'across', 'turning']
TURN_RADIUS = 8.0  # metres


@dataclass(frozen=True)
class Course:
    """Path of a vehicle in street coordinates, one place for each scan.

    Attributes:
        s: metres along the road.
        lateral: metres to the left of its centre line.
    """

    s: Float[np.ndarray, ' n']
    lateral: Float[np.ndarray, ' n']


def route_number(route: Route) -> int:
    """Number of a route, to seed what is random about it.

    Raises:
        GclError: unknown route.
    """
    if route not in get_args(Route):
        raise GclError(f'unknown route {route!r}; choose one of {", ".join(get_args(Route))}')
    return get_args(Route).index(route)


def course(route: Route, terrain: Terrain, travelled: Float[np.ndarray, ' n']) -> Course:
    """Lay a route into the street.

    Args:
        route: along the road, against it, on a side street, or turning into one.
        terrain: the street.
        travelled: metres from the middle of the route at each scan.

    Raises:
        GclError: the street has no side street for it.
    """
    lane = 0.4 * terrain.half_road
    if route == 'along':
        return Course(travelled, np.full_like(travelled, -lane))
    if route == 'oncoming':
        return Course(-travelled, np.full_like(travelled, lane))
    middle, half = nearest_crossing(terrain)
    if route == 'across':
        return Course(np.full_like(travelled, middle + 0.4 * half), travelled)
    corner = middle + 0.4 * half
    before = np.minimum(travelled + TURN_RADIUS, 0.0)
    angle = np.clip((travelled + TURN_RADIUS) / (np.pi / 2 * TURN_RADIUS), 0, 1) * np.pi / 2
    after = np.maximum(travelled + TURN_RADIUS - np.pi / 2 * TURN_RADIUS, 0.0)
    s = corner - TURN_RADIUS + before + TURN_RADIUS * np.sin(angle)
    return Course(s, -lane + TURN_RADIUS * (1 - np.cos(angle)) + after)


def nearest_crossing(terrain: Terrain) -> tuple[float, float]:
    """The side street nearest to the middle of the road: (s, half width).

    Raises:
        GclError: there is none within 100 m.
    """
    near = [c for c in terrain.crossings if abs(c[0]) < 100.0]
    if not near:
        raise GclError('this street has no side street near its middle; take another seed')
    return min(near, key=lambda c: abs(c[0]))


class Drive:
    """Poses of a sensor on a vehicle that follows a course.

    Args:
        terrain: the street.
        where: course, one place for each scan.
        times: seconds of each scan.
        rng: decides the sensor's height and mounting, and the body's motion.

    Attributes:
        poses: T_world_lidar in the middle of each scan.
        twist: forward speed (m/s) and yaw rate (rad/s) at each scan.
        ground: x, y, z on the ground (m, world frame) and heading (rad) at each scan.
    """

    def __init__(
        self,
        terrain: Terrain,
        where: Course,
        times: Float[np.ndarray, ' n'],
        rng: np.random.Generator,
    ) -> None:
        sway = rng.uniform(0.1, 0.5) * np.sin(times * rng.uniform(0.2, 0.8) + rng.uniform(0, 6))
        s, lateral = where.s, where.lateral
        bend = np.gradient(lateral) if len(s) > 1 else np.zeros(1)
        straight = np.abs(bend) < 1e-6  # sway only where the vehicle keeps its lane
        lateral = lateral + sway * straight
        xy = terrain.xy(s, lateral)
        z = terrain.height(s, np.round(lateral, 3))
        step = np.gradient(times)
        velocity = np.stack([np.gradient(xy[:, 0]), np.gradient(xy[:, 1])], 1) / step[:, None]
        speed = np.linalg.norm(velocity, axis=1)
        yaw = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
        pitch = -np.arctan2(np.gradient(z) / step, np.maximum(speed, 1.0))
        pitch = np.convolve(np.pad(pitch, 2, mode='edge'), np.full(5, 0.2), mode='valid')
        height = rng.uniform(1.5, 2.2)
        mounting = rng.normal(size=2) * 0.008
        self.ground = np.column_stack([xy, z, yaw])
        roll = mounting[0] + _body_motion(times, 0.008, rng)
        pitch = pitch + mounting[1] + _body_motion(times, 0.007, rng)
        self.poses = np.stack(
            [_pose(*row) for row in np.column_stack([xy, z + height, roll, pitch, yaw])]
        )
        self.twist = np.column_stack([speed, np.gradient(yaw) / step])


def _pose(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> np.ndarray:
    return se3.from_xyz_rpy(x=x, y=y, z=z, roll=roll, pitch=pitch, yaw=yaw)


def _body_motion(
    times: Float[np.ndarray, ' n'], size: float, rng: np.random.Generator
) -> Float[np.ndarray, ' n']:
    """Sum of three slow oscillations, radians, of standard deviation `size`."""
    motion = np.zeros_like(times)
    for frequency in rng.uniform(0.1, 1.5, 3):
        motion += np.sin(2 * np.pi * frequency * times + rng.uniform(0, 2 * np.pi))
    return motion * size * np.sqrt(2 / 3)
