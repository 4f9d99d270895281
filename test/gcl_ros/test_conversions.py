"""PointCloud2 in every layout that drivers send."""

from types import SimpleNamespace as Fake

import numpy as np
import pytest
from geometry_msgs.msg import Transform
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_ros.conversions import fill_point_cloud2, fill_transform, matrix, point_cloud, seconds

POINTS = np.arange(12, dtype=np.float32).reshape(4, 3)


def message() -> PointCloud2:
    return fill_point_cloud2(PointCloud2(), POINTS, PointField)


def test_round_trip():
    np.testing.assert_array_equal(point_cloud(message()).points, POINTS)


def test_driver_layout_with_padding_rows_and_doubles():
    layout = np.dtype(
        {'names': ['i', 'z', 'x', 'y'], 'formats': ['<u2', '<f8', '<f4', '<f8']}
        | {'offsets': [0, 4, 12, 16], 'itemsize': 32}
    )
    cells = np.zeros((2, 3), layout)  # two rows of two points and 32 bytes of padding
    for axis, column in zip('xyz', POINTS.T, strict=True):
        cells[axis][:, :2] = column.reshape(2, 2)
    m = message()
    m.height, m.width, m.point_step, m.row_step = 2, 2, 32, 96
    m.fields = [
        PointField(name='x', offset=12, datatype=7, count=1),
        PointField(name='y', offset=16, datatype=8, count=1),
        PointField(name='z', offset=4, datatype=8, count=1),
    ]
    m.data = cells.tobytes()
    np.testing.assert_array_equal(point_cloud(m).points, POINTS)


def test_big_endian():
    m = message()
    m.is_bigendian = True
    m.data = POINTS.astype('>f4').tobytes()
    np.testing.assert_array_equal(point_cloud(m).points, POINTS)


def broken(change) -> PointCloud2:
    m = message()
    change(m)
    return m


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (lambda m: setattr(m, 'width', 0), 'empty'),
        (lambda m: setattr(m, 'width', 4_000_000_000), 'claims 4000000000 points'),
        (lambda m: setattr(m, 'data', b'123'), 'carries 3 bytes'),
        (lambda m: m.fields.pop(), "no field 'z'"),
        (lambda m: setattr(m.fields[0], 'datatype', 5), "'x' has datatype 5"),
        (lambda m: setattr(m.fields[1], 'offset', 11), "'y' lies outside"),
        (lambda m: setattr(m, 'data', np.full((4, 3), np.nan, 'f4').tobytes()), 'is finite'),
    ],
)
def test_bad_clouds_are_named(change, text):
    with pytest.raises(GclError, match=text):
        point_cloud(broken(change))


def test_transform_round_trip():
    T = se3.from_xyz_rpy(1, -2, 3, 0.1, 0.2, 3.0)
    np.testing.assert_allclose(matrix(fill_transform(Transform(), T)), T, atol=1e-12)


def test_seconds():
    assert seconds(Fake(sec=3, nanosec=250_000_000)) == 3.25
