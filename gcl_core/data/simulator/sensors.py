"""Spinning LiDARs: beam tables, range noise, and which returns come back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from jaxtyping import Float

from gcl_core.data.simulator.primitives import Triangles
from gcl_core.errors import GclError
from gcl_core.types import PointCloud


@dataclass(frozen=True)
class Sensor:
    """A spinning LiDAR.

    Attributes:
        elevation_deg: angle of each beam above the horizon.
        columns: firings per turn.
        max_range: metres.
        range_noise: standard deviation, metres.
        weak_return: strength below which a return is lost, see `Scene.cast`.
    """

    elevation_deg: tuple[float, ...]
    columns: int
    max_range: float
    range_noise: float
    weak_return: float


def _beams(first: float, last: float, count: int) -> tuple[float, ...]:
    return tuple(np.linspace(first, last, count).tolist())


SENSORS = {
    # Velodyne HDL-64E S2 manual: 32 upper beams 1/3 degree apart, 32 lower ones 1/2 degree apart.
    'hdl64e': Sensor(_beams(2.0, -8.33, 32) + _beams(-8.83, -24.33, 32), 2000, 80.0, 0.02, 0.05),
    # Velodyne HDL-32E manual: 1.33 degrees apart.
    'hdl32e': Sensor(_beams(10.67, -30.67, 32), 1084, 70.0, 0.02, 0.08),
}


def sensor_named(name: str) -> Sensor:
    """Look a sensor up.

    Raises:
        GclError: no such sensor.
    """
    if name not in SENSORS:
        raise GclError(f'unknown sensor {name!r}; choose one of {", ".join(SENSORS)}')
    return SENSORS[name]


class Scene:
    """Triangles that beams can be cast at."""

    def __init__(self, triangles: Triangles) -> None:
        self._scene = o3d.t.geometry.RaycastingScene()
        vertices = np.ascontiguousarray(triangles.reshape(-1, 3), dtype=np.float32)
        faces = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))

    def cast(
        self, rays: Float[np.ndarray, 'n 6']
    ) -> tuple[Float[np.ndarray, ' n'], Float[np.ndarray, ' n']]:
        """Return distance (inf where nothing is hit) and cosine of the angle of incidence."""
        hit = self._scene.cast_rays(o3d.core.Tensor(rays))
        normals = hit['primitive_normals'].numpy()
        cosine = np.abs((normals * rays[:, 3:]).sum(1))
        return hit['t_hit'].numpy(), cosine


def scan(
    sensor: Sensor,
    scenes: list[Scene],
    T_world_lidar: Float[np.ndarray, '4 4'],
    rng: np.random.Generator,
) -> PointCloud:
    """Turn the sensor once and return the points it gets, in its own frame.

    A return's strength is reflectance x cosine of incidence x (max_range / range)^2, with a
    random reflectance; below `weak_return` it is lost. 3 % are lost at random.
    """
    elevation = (
        np.deg2rad(sensor.elevation_deg) + rng.normal(size=len(sensor.elevation_deg)) * 3e-4
    )
    azimuth = np.linspace(0, 2 * np.pi, sensor.columns, endpoint=False) + rng.uniform(0, 2e-3)
    E, A = np.meshgrid(elevation, azimuth, indexing='ij')
    beam = np.stack([np.cos(E) * np.cos(A), np.cos(E) * np.sin(A), np.sin(E)], -1).reshape(-1, 3)
    rays = np.empty((len(beam), 6), dtype=np.float32)
    rays[:, :3] = T_world_lidar[:3, 3]
    rays[:, 3:] = beam @ T_world_lidar[:3, :3].T
    distance, cosine = scenes[0].cast(rays)
    for scene in scenes[1:]:
        nearer, nearer_cosine = scene.cast(rays)
        cosine = np.where(nearer < distance, nearer_cosine, cosine)
        distance = np.minimum(distance, nearer)
    reflectance = rng.lognormal(-1.0, 0.8, len(beam))
    strength = reflectance * cosine * (sensor.max_range / np.maximum(distance, 1.0)) ** 2
    seen = (distance > 1.5) & (distance < sensor.max_range) & (strength > sensor.weak_return)
    seen &= rng.random(len(beam)) > 0.03
    measured = distance[seen] + rng.normal(size=int(seen.sum())) * sensor.range_noise
    return PointCloud((beam[seen] * measured[:, None]).astype(np.float32))
