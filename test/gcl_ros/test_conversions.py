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
        (lambda m: setattr(m, 'point_step', 0), 'lies outside the 0 bytes'),
        (lambda m: setattr(m.fields[1], 'datatype', 99), "'y' has datatype 99"),
        (
            lambda m: setattr(m, 'data', np.full((4, 3), np.nan, 'f4').tobytes()),
            'points is finite',
        ),
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


@pytest.mark.parametrize('seed', range(20))
def test_any_legal_layout_is_read(seed):
    """Field order, offsets, padding, doubles, byte order, rows, other fields, points to drop."""
    rng = np.random.default_rng(seed)
    height, width = (int(n) for n in rng.integers(1, 6, 2))
    points = rng.normal(size=(height * width, 3)).astype(np.float32)
    points[1:][rng.random(height * width - 1) < 0.3] = rng.choice([np.nan, np.inf, -np.inf])
    order = rng.choice(['<', '>'])
    names = [*'xyz', *rng.choice(['intensity', 'ring', 't'], size=rng.integers(0, 4))]
    fields, formats, offset = [], [], 0
    for i in rng.permutation(len(names)):
        kind = int(rng.integers(7, 9)) if names[i] in 'xyz' else int(rng.integers(1, 9))
        offset += int(rng.integers(0, 5))
        fields.append(PointField(name=names[i], offset=offset, datatype=kind, count=1))
        formats.append((names[i], order + 'i1u1i2u2i4u4f4f8'[2 * kind - 2 : 2 * kind], offset))
        offset += int(formats[-1][1][2])
    step, padding = offset + int(rng.integers(0, 9)), int(rng.integers(0, 9))
    data = rng.integers(0, 256, (height, width * step + padding)).astype(np.uint8)
    for name, kind, start in formats:
        if name in 'xyz':
            values = points[:, 'xyz'.index(name)].astype(kind).reshape(height, width, 1)
            for row in range(height):
                cells = data[row, : width * step].reshape(width, step)
                cells[:, start : start + int(kind[2])] = values[row].view(np.uint8)
    m = PointCloud2(height=height, width=width, fields=fields, is_bigendian=bool(order == '>'))
    m.point_step, m.row_step, m.data = step, width * step + padding, data.tobytes()
    np.testing.assert_array_equal(point_cloud(m).points, points[np.isfinite(points).all(1)])


def test_a_thousand_malformed_clouds_are_read_or_refused(malformed):
    refused = 0
    for seed in range(1000):
        m = malformed(seed)
        try:
            cloud = point_cloud(m)
        except GclError:
            refused += 1
        else:
            assert 0 < len(cloud) <= m.width * m.height
            assert np.isfinite(cloud.points).all()
    assert 600 < refused < 1000
