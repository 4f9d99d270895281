"""Clouds with something wrong about them."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from gcl_ros.conversions import fill_point_cloud2


@pytest.fixture(scope='session')
def malformed():
    """Function of a seed."""
    return make_malformed


def make_malformed(seed: int) -> PointCloud2:
    """A cloud with one to three things about it drawn at random."""
    rng = np.random.default_rng(seed)
    m = fill_point_cloud2(PointCloud2(), rng.normal(size=(64, 3)), PointField)
    m.header.frame_id = rng.choice(['', 'lidar', 'ä/\n'])
    pick = lambda: rng.integers(len(m.fields))  # noqa: E731
    number = lambda: int(rng.choice([0, 1, 3, 7, 64, 65, 255, 2**16, 2**31, 2**32 - 1]))  # noqa: E731
    changes = [
        lambda: setattr(m, 'width', number()),
        lambda: setattr(m, 'height', number()),
        lambda: setattr(m, 'point_step', number()),
        lambda: setattr(m, 'row_step', number()),
        lambda: setattr(m, 'data', rng.bytes(int(rng.integers(0, 2000)))),
        lambda: setattr(m, 'is_bigendian', True),
        lambda: setattr(m.fields[pick()], 'offset', number()),
        lambda: setattr(m.fields[pick()], 'datatype', int(rng.integers(0, 256))),
        lambda: setattr(m.fields[pick()], 'count', number()),
        lambda: setattr(m.fields[pick()], 'name', str(rng.choice(['', 'x', 'rgb']))),
        lambda: setattr(m, 'fields', m.fields[: pick()]),
        lambda: setattr(m, 'fields', [*m.fields, *m.fields]),
    ]
    for i in rng.choice(len(changes), size=rng.integers(1, 4), replace=False):
        if m.fields:
            changes[i]()
    return m
