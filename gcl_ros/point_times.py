"""When each point of a cloud was seen, where its points tell.

Known fields: `t` (Ouster), `time` (Velodyne), `timestamp` (Hesai, RoboSense, Livox), `time_stamp`
(Autoware), `offset_time` (Livox). Their unit is what makes a sweep of the span of their values, as
drivers do not agree on it; they count from the stamp of the header, or from where it counts from.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from gcl_ros.conversions import column, finite, name_of, seconds

TIMES = ('t', 'time', 'timestamp', 'time_stamp', 'offset_time')
UNITS = (1.0, 1e-3, 1e-6, 1e-9)  # seconds, each a thousand times the next
SHORTEST, LONGEST = 5e-3, 1.0  # seconds of a sweep: at most one unit fits
WILD = 5.0  # sweeps from the middle: what lies beyond is no time


@dataclass(frozen=True)
class Times:
    """When the points of a cloud were seen.

    Attributes:
        seconds: of each point after the stamp of the header, NaN where it has no time; None where
            the cloud tells no times that can be used.
        why: they cannot; empty if they can.
    """

    seconds: Float[np.ndarray, ' n'] | None
    why: str = ''


def point_times(message: Any, points: Float[np.ndarray, 'n 3']) -> Times:
    """Read the times of all points.

    Args:
        message: sensor_msgs/PointCloud2 that has passed `every_point`.
        points: what came out; those that are not finite or zero were not seen.

    Raises:
        GclError: the field lies outside the point.
    """
    field = next((f for f in message.fields if f.name in TIMES and f.count <= 1), None)
    if field is None:
        return Times(None, f'its points tell no times (no field {", ".join(TIMES)})')
    name = f'its field {field.name!r}'
    values = column(message, field, name_of(message)).reshape(-1).astype(np.float64)
    told = np.isfinite(values)
    seen = told & finite(points) & points.any(axis=1)
    if not seen.any():
        return Times(None, f'{name} is no number at any of the points seen')
    low, middle, high = np.quantile(values[seen], (0.25, 0.5, 0.75))
    span = 2 * (high - low)  # of the sweep, whatever a quarter of the values at each end is
    if span == 0:
        return Times(None, f'{name} is {middle:g} at most points: its driver does not fill it')
    unit = next((u for u in UNITS if SHORTEST <= span * u < LONGEST), None)
    if unit is None:
        return Times(None, f'{name} spans {span:.3g}: no sweep in s, ms, us or ns')
    times, centre = values * unit, middle * unit
    if abs(centre) > LONGEST:
        stamp = seconds(message.header.stamp)
        if abs(centre - stamp) > LONGEST:
            apart = f'{centre - stamp:+.1f} s from the stamp of the cloud'
            return Times(None, f'{name} is {apart}: another clock')
        times, centre = times - stamp, centre - stamp
    known = told & (np.abs(times - centre) <= min(WILD * span * unit, LONGEST))
    return Times(np.where(known, times, np.nan))
