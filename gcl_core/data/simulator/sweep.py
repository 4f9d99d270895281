"""One sweep of a sensor on a moving vehicle through a world with moving traffic."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32

from gcl_core import se3
from gcl_core.data.simulator.casting import Scene, nearer
from gcl_core.data.simulator.returns import Conditions, measure
from gcl_core.data.simulator.sensors import Sensor
from gcl_core.data.simulator.surfaces import Soup
from gcl_core.data.simulator.traffic import Moment
from gcl_core.types import PointCloud


def sweep(
    sensor: Sensor,
    static: Scene,
    moment: Moment | None,
    T_world_lidar: Float[np.ndarray, '4 4'],
    twist: Float[np.ndarray, '2'],
    conditions: Conditions,
    rng: np.random.Generator,
) -> PointCloud:
    """Return the points of one sweep in the sensor's frame at the middle of the sweep.

    Args:
        sensor: its beams.
        static: what stands still.
        moment: what moves, at the middle of the sweep.
        T_world_lidar: pose at the middle of the sweep.
        twist: forward speed (m/s) and yaw rate (rad/s) of the sensor.
        conditions: noise, losses, de-skewing.
        rng: decides what is random.
    """
    elevation, azimuth, delay = _firings(sensor, rng)
    origin, beam = _beams(elevation, azimuth, delay, twist)
    rays = np.empty((*beam.shape[:2], 6), dtype=np.float32)
    rays[..., :3] = se3.transform(T_world_lidar, origin)
    rays[..., 3:] = beam @ T_world_lidar[:3, :3].T.astype(np.float32)
    hits = static.cast(rays)
    if moment is not None and len(moment.soup):
        soup, columns = _seen_moving(sensor, moment, se3.inverse(T_world_lidar), azimuth)
        if columns.any():
            hits = nearer(hits, Scene(soup).cast(np.ascontiguousarray(rays[:, columns])), columns)
    measured = measure(sensor, hits, azimuth, conditions, rng)
    if conditions.deskew != 1.0:
        origin, beam = _beams(elevation, azimuth, delay, twist * conditions.deskew)
    row, column = np.nonzero(measured)
    points = beam[row, column] * measured[row, column, None] + origin[column]
    return PointCloud(points.astype(np.float32))


def _firings(
    sensor: Sensor, rng: np.random.Generator
) -> tuple[Float32[np.ndarray, ' r'], Float32[np.ndarray, ' c'], Float32[np.ndarray, ' c']]:
    """Elevation of the beams, azimuth of the firings (radians), seconds from mid-sweep."""
    rows, field = np.array(sensor.elevation_deg), np.deg2rad(sensor.field_deg)
    spacing = np.ptp(rows) / (len(rows) - 1)
    rows = rows + rng.uniform(-0.5, 0.5) * sensor.row_shift * spacing
    elevation = np.deg2rad(rows) + rng.normal(size=len(rows)) * 3e-4
    sweep_share = (np.arange(sensor.columns) + rng.uniform()) / sensor.columns - 0.5
    jitter = rng.normal(size=sensor.columns) * 2e-4
    azimuth = sweep_share * field + jitter
    delay = sweep_share * sensor.period
    return elevation.astype('f4'), azimuth.astype('f4'), delay.astype('f4')


def _beams(
    elevation: Float32[np.ndarray, ' r'],
    azimuth: Float32[np.ndarray, ' c'],
    delay: Float32[np.ndarray, ' c'],
    twist: Float[np.ndarray, '2'],
) -> tuple[Float32[np.ndarray, 'c 3'], Float32[np.ndarray, 'r c 3']]:
    """Origin and direction of each firing in the mid-sweep frame of a sensor that moves."""
    speed, yaw_rate = np.float32(twist)
    origin = np.zeros((len(delay), 3), dtype=np.float32)
    origin[:, 0] = speed * delay
    turned = azimuth + yaw_rate * delay
    beam = np.empty((len(elevation), len(azimuth), 3), dtype=np.float32)
    level = np.cos(elevation)[:, None]
    beam[..., 0] = level * np.cos(turned)
    beam[..., 1] = level * np.sin(turned)
    beam[..., 2] = np.sin(elevation)[:, None]
    return origin, beam


def _seen_moving(
    sensor: Sensor,
    moment: Moment,
    T_lidar_world: Float[np.ndarray, '4 4'],
    azimuth: Float32[np.ndarray, ' c'],
) -> tuple[Soup, np.ndarray]:
    """Move each corner to where it is when the sweep passes it; tell which firings may meet it."""
    corners = moment.soup.triangles
    local = se3.transform(T_lidar_world, corners.reshape(-1, 3))
    field = np.deg2rad(sensor.field_deg)
    angle = np.arctan2(local[:, 1], local[:, 0])
    delay = np.clip(angle / field, -0.5, 0.5) * sensor.period
    velocity = moment.velocity[moment.owner]
    moved = corners + delay.reshape(-1, 3, 1) * velocity[:, None]
    soup = Soup(moved.astype(np.float32), moment.soup.reflectance, moment.soup.depth)
    # Bins of 3 degrees, one more on either side: an owner's corners may lie either side of a bin.
    bins = np.zeros(120, dtype=bool)
    for owner in np.unique(moment.owner):
        own = angle.reshape(-1, 3)[moment.owner == owner].ravel()
        middle = np.arctan2(np.sin(own).mean(), np.cos(own).mean())
        reach = np.abs((own - middle + np.pi) % (2 * np.pi) - np.pi).max() + 0.06
        index = np.arange(
            np.floor((middle - reach) / np.pi * 60), (middle + reach) / np.pi * 60 + 1
        )
        bins[index.astype(int) % 120] = True
    column_bin = np.floor(azimuth / np.pi * 60).astype(int) % 120
    return soup, bins[column_bin]
