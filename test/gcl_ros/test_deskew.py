"""A scan taken on the move, seen as if at once."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_ros.conversions import fill_point_cloud2
from gcl_ros.deskew import deskewed, point_times
from gcl_ros.motion import Odometry

STAMP = 100.0
WORLD = np.random.default_rng(0).uniform(-40, 40, (400, 3))
TIMES = np.repeat(np.linspace(-0.05, 0.05, 20), 20)  # seconds after the stamp


def pose(stamp):
    """20 m/s in a bend."""
    return se3.from_xyz_rpy(x=20 * (stamp - STAMP), z=1.8, yaw=0.5 * (stamp - STAMP))


@pytest.fixture
def odometry():
    made = Odometry()
    for stamp in np.arange(STAMP - 0.5, STAMP + 0.5, 0.01):
        made.add(float(stamp), pose(float(stamp)))
    return made


def seen():
    """Each point in the sensor's frame of its own time."""
    points = [
        se3.transform(se3.inverse(pose(STAMP + t)), p[None])[0]
        for p, t in zip(WORLD, TIMES, strict=True)
    ]
    return np.array(points, dtype=np.float32)


def scan(name='time', values=TIMES, kind='<f4', datatype=7):
    cells = np.zeros(400, [('p', '<f4', 3), ('t', kind)])
    cells['p'], cells['t'] = seen(), values
    message = fill_point_cloud2(PointCloud2(), cells['p'], PointField)
    message.fields.append(PointField(name=name, offset=12, datatype=datatype, count=1))
    message.point_step, message.row_step = cells.itemsize, cells.nbytes
    message.data = cells.tobytes()
    message.header.stamp.sec = int(STAMP)
    return message


@pytest.mark.parametrize(
    ('name', 'values', 'kind', 'datatype'),
    [
        ('time', TIMES, '<f4', 7),
        ('t', np.round(TIMES * 1e9), '<i4', 5),
        ('timestamp', TIMES, '<f8', 8),
    ],
)
def test_points_come_to_where_they_are_at_the_stamp(odometry, name, values, kind, datatype):
    expected = se3.transform(se3.inverse(pose(STAMP)), WORLD)
    assert np.linalg.norm(seen() - expected, axis=1).max() > 0.9
    after = deskewed(scan(name, values, kind, datatype), odometry).points
    assert np.linalg.norm(after - expected, axis=1).max() < 0.15  # half a step of 5 ms


def test_times_since_the_epoch_count_from_the_stamp():
    message = scan('timestamp', 1.7e9 + TIMES, '<f8', 8)
    message.header.stamp.sec = 1_700_000_000
    np.testing.assert_allclose(point_times(message), TIMES, atol=1e-6)


def test_without_times_or_odometry_nothing_is_done(odometry):
    assert deskewed(fill_point_cloud2(PointCloud2(), WORLD, PointField), odometry) is None
    assert deskewed(scan(), Odometry()) is None
    assert deskewed(scan(values=TIMES * 1000), odometry) is None  # milliseconds: another meaning
    assert deskewed(scan(values=np.full(400, np.nan)), odometry) is None


def test_a_time_field_outside_the_point_is_refused(odometry):
    message = scan()
    message.fields[3].offset = 15
    with pytest.raises(GclError, match="'time' lies outside"):
        deskewed(message, odometry)
