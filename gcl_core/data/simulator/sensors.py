"""LiDARs: where their beams point, how far they reach and how well they measure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcl_core.errors import GclError


@dataclass(frozen=True)
class Sensor:
    """A LiDAR that sweeps from one end of its field of view to the other.

    Attributes:
        elevation_deg: angle of each beam above the horizon.
        columns: firings in a sweep.
        max_range: metres.
        range_noise: standard deviation near a surface hit head-on, metres.
        weak_return: strength below which a return is lost, see `returns.py`.
        field_deg: horizontal field of view around the front.
        period: seconds for a sweep.
        row_shift: the beams move up or down by up to this share of their spacing from one scan
            to the next: a pattern that does not repeat.
    """

    elevation_deg: tuple[float, ...]
    columns: int
    max_range: float
    range_noise: float
    weak_return: float
    field_deg: float = 360.0
    period: float = 0.1
    row_shift: float = 0.0


def _beams(first: float, last: float, count: int) -> tuple[float, ...]:
    return tuple(np.linspace(first, last, count).tolist())


# Dense in the middle, sparse outside, like Hesai's Pandar128; angles approximate.
_PANDAR = (
    (-25.0, -20.0, -16.6, -13.9, -11.8, -10.3, -9.3, -8.4, -7.8, -7.2)
    + _beams(-6.8, 4.95, 95)
    + (5.2, 5.4, 5.7, 5.9, 6.1, 6.3, 6.6, 7.0, 7.5, 8.0, 8.6, 9.1, 9.7, 10.3)
    + (10.9, 11.5, 12.2, 12.8, 13.4, 13.9, 14.3, 14.7, 15.0)
)

SENSORS = {
    # Velodyne HDL-64E S2 manual: 32 upper beams 1/3 degree apart, 32 lower ones 1/2 degree apart.
    'hdl64e': Sensor(_beams(2.0, -8.33, 32) + _beams(-8.83, -24.33, 32), 2083, 80.0, 0.02, 0.03),
    # Velodyne HDL-32E manual: 1.33 degrees apart; 2,170 firings at 10 Hz, 1,084 at 20 Hz.
    'hdl32e': Sensor(_beams(10.67, -30.67, 32), 2170, 90.0, 0.02, 0.08),
    'hdl32e_20hz': Sensor(_beams(10.67, -30.67, 32), 1084, 90.0, 0.02, 0.08, period=0.05),
    # Velodyne VLP-16 manual: 2 degrees apart, 0.2 degrees between firings at 10 Hz.
    'vlp16': Sensor(_beams(15.0, -15.0, 16), 1800, 90.0, 0.02, 0.08),
    'pandar128': Sensor(_PANDAR, 1800, 120.0, 0.02, 0.03),
    # Ouster OS1-128 data sheet: 45 degrees vertically, 1,024 columns.
    'os1_128': Sensor(_beams(22.5, -22.5, 128), 1024, 100.0, 0.02, 0.05),
    # A solid-state LiDAR's field of view of 120 x 25 degrees, rows that shift between scans.
    'solid120': Sensor(
        _beams(12.5, -12.5, 100), 600, 120.0, 0.03, 0.03, field_deg=120.0, row_shift=1.0
    ),
}


def sensor_named(name: str) -> Sensor:
    """Look a sensor up.

    Raises:
        GclError: no such sensor.
    """
    if name not in SENSORS:
        raise GclError(f'unknown sensor {name!r}; choose one of {", ".join(SENSORS)}')
    return SENSORS[name]
