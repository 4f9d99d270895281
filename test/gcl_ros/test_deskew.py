"""A scan taken on the move, seen as if at once."""

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_ros.conversions import fill_point_cloud2
from gcl_ros.deskew import deskewed
from gcl_ros.odometry import Odometry

STAMP = 100.0
WORLD = np.random.default_rng(0).uniform(-40, 40, (400, 3))
TIMES = np.repeat(np.linspace(-0.05, 0.05, 20), 20)  # seconds after the stamp


def pose(stamp):
    """20 m/s in a bend."""
    turn = 0.5 * (stamp - STAMP)
    return se3.from_xyz_rpy(x=40 * np.sin(turn), y=40 - 40 * np.cos(turn), z=1.8, yaw=turn)


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


def truth():
    return se3.transform(se3.inverse(pose(STAMP)), WORLD)


def test_points_come_to_where_they_are_at_the_stamp(odometry):
    """Each by its own time: what is left is the rounding of the points."""
    assert np.linalg.norm(seen() - truth(), axis=1).max() > 0.9
    after = deskewed(scan(), odometry)
    assert np.linalg.norm(after.cloud.points - truth(), axis=1).max() < 1e-4
    assert (after.why, after.timeless) == ('', 0)
    assert not after.left.any()


@pytest.mark.parametrize('rate', [5, 10, 200])
def test_odometry_that_is_slower_than_the_sweep_does(rate):
    """The poses lie on an arc; the sensor moves along it in between."""
    sparse = Odometry()
    for stamp in np.arange(STAMP - 0.5, STAMP + 0.5, 1 / rate):
        sparse.add(float(stamp), pose(float(stamp)))
    after = deskewed(scan(), sparse).cloud.points
    assert np.linalg.norm(after - truth(), axis=1).max() < 0.002


@pytest.mark.parametrize('wild', [np.nan, np.inf, 0.0, 7.0, -1e9])
@pytest.mark.parametrize('where', [slice(0, 1), slice(200, 201), slice(0, 400, 11)])
def test_points_without_a_time_stay_and_the_others_are_moved(odometry, wild, where):
    """Times since the epoch, of which some are none: no return, a bit that fell over."""
    times = STAMP + TIMES
    times[where] = wild
    after = deskewed(scan('timestamp', times, '<f8', 8), odometry)
    timed = np.ones(400, bool)
    timed[where] = False
    assert np.linalg.norm(after.cloud.points - truth(), axis=1)[timed].max() < 1e-4
    np.testing.assert_array_equal(after.cloud.points[~timed], seen()[~timed])
    assert after.timeless == np.sum(~timed)


def test_what_was_not_seen_has_no_say_in_the_times(odometry):
    """Half of the points are at zero or nowhere, with a time of zero."""
    message = scan('timestamp', STAMP + TIMES, '<f8', 8)
    cells = np.frombuffer(bytearray(message.data), [('p', '<f4', 3), ('t', '<f8')])
    cells['p'][::4], cells['t'][::4] = 0.0, 0.0
    cells['p'][1::4], cells['t'][1::4] = np.nan, 0.0
    message.data = cells.tobytes()
    after = deskewed(message, odometry)
    assert len(after.cloud) == 300
    assert np.linalg.norm(after.cloud.points[1::3] - truth()[2::4], axis=1).max() < 1e-4


@pytest.mark.parametrize(
    ('message', 'sweep', 'metres'),
    [
        (lambda: fill_point_cloud2(PointCloud2(), WORLD, PointField), 0.1, 2.0),
        (lambda: fill_point_cloud2(PointCloud2(), WORLD, PointField), 0.05, 1.0),
        (lambda: scan(values=TIMES * 0), 0.1, 2.0),
        (lambda: scan(values=TIMES * 0), 0.0, 0.0),
    ],
)
def test_motion_that_is_not_undone_is_left(odometry, message, sweep, metres):
    message = message()
    message.header.stamp.sec = int(STAMP)
    after = deskewed(message, odometry, sweep)
    assert after.cloud is None
    assert bool(after.why) == bool(sweep)
    np.testing.assert_allclose(after.left[:3], [metres, 0, 0], atol=0.1)
    assert after.left[5] == pytest.approx(0.5 * sweep, abs=1e-6)


@pytest.mark.parametrize('until', [STAMP - 0.06, STAMP + 0.02])
def test_a_scan_that_odometry_does_not_reach_keeps_its_motion_by_the_last_speed(until):
    odometry = Odometry()
    for stamp in np.arange(STAMP - 0.5, until + 1e-9, 0.02):
        odometry.add(float(stamp), pose(float(stamp)))
    after = deskewed(scan(), odometry)
    assert after.cloud is None
    assert 'odometry ends 0.0' in after.why
    np.testing.assert_allclose(after.left[:3], [2.0, 0, 0], atol=0.1)  # the sweep is 0.1 s


def test_without_odometry_nothing_is_known_of_the_motion():
    after = deskewed(scan(), Odometry())
    assert (after.cloud, after.why) == (None, 'no odometry came')
    assert not after.left.any()


def test_a_time_field_outside_the_point_is_refused(odometry):
    message = scan()
    message.fields[3].offset = 15
    with pytest.raises(GclError, match="'time' lies outside"):
        deskewed(message, odometry)
