"""What drivers, clocks and launch files get wrong, a row each, and what is made of it.

A report of another such input becomes a row: what is sent, how it ends, and in which words.
"""

import array
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest
import rclpy
from nav_msgs.msg import Odometry
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import String

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import Registration
from gcl_ros import odometry
from gcl_ros.conversions import fill_point_cloud2, fill_pose, point_cloud
from gcl_ros.deskew import deskewed
from gcl_ros.health import ERROR, OK, WARN, Health, Outcome
from gcl_ros.pairing import SIDES
from gcl_ros.registrar_node import RegistrarNode
from gcl_ros.streams import Limits
from gcl_ros.tracking import DISAGREE, MotionConfig, Tracking

POINTS = np.random.default_rng(0).uniform(-40, 40, (600, 3)).astype(np.float32)
NOW = 1_795_000_000.0  # seconds since 1970


def cloud(points=POINTS, *, rows=1, padding=0, **settings):
    """A PointCloud2 of x, y, z in rows, with something set otherwise."""
    message = fill_point_cloud2(PointCloud2(), points, PointField)
    width = len(points) // rows
    message.height, message.width, message.row_step = rows, width, 12 * width + padding
    data = points.reshape(rows, 3 * width).view(np.uint8)
    message.data = np.pad(data, ((0, 0), (0, padding))).tobytes()
    for name, value in settings.items():
        setattr(message, name, value)
    return message


# Name, message, and the words of its refusal; none where it is read.
MESSAGES = [
    ('one row', cloud(), ''),
    ('several rows', cloud(rows=6), ''),
    ('rows that are padded', cloud(rows=6, padding=20), ''),
    ('row_step is 0', cloud(row_step=0), ''),
    ('row_step is 0, several rows', cloud(rows=6, row_step=0), ''),
    ('row_step is point_step', cloud(rows=6, row_step=12), ''),
    ('row_step counts points', cloud(rows=6, row_step=100), ''),
    ('row_step is that of all rows', cloud(rows=6, row_step=7200), ''),
    ('bytes follow the only row', cloud(data=POINTS.tobytes() + b'more'), ''),
    ('height is 0', cloud(height=0), 'height 0 and width 600, but carries 7200 bytes'),
    ('width is 0', cloud(width=0), 'height 1 and width 0, but carries 7200 bytes'),
    ('nothing at all', cloud(width=0, data=b''), 'is empty; check the driver'),
    ('cut off', cloud(data=POINTS.tobytes()[:-1]), 'carries 7199 bytes'),
    ('row_step and size disagree', cloud(rows=6, row_step=900, data=POINTS.tobytes() + b'1'),
     'height 6, width 100, point_step 12, row_step 900'),
]  # fmt: skip


@pytest.mark.parametrize('row', MESSAGES, ids=lambda row: row[0])
def test_point_clouds(row):
    _, message, words = row
    if words:
        with pytest.raises(GclError, match=words):
            point_cloud(message)
    else:
        np.testing.assert_array_equal(point_cloud(message).points, POINTS)


# Name, field, its type in numpy and in ROS, its values; the seconds after the stamp that they are
# taken for, or why scans are not de-skewed.
SWEEP = np.linspace(0.0, 0.1, 600)
TIMES = [
    ('Ouster: t, ns after the stamp', 't', '<u4', 6, SWEEP * 1e9, SWEEP),
    ('Velodyne: time, s', 'time', '<f4', 7, SWEEP, SWEEP),
    ('Velodyne: time, s before the stamp', 'time', '<f4', 7, SWEEP - 0.1, SWEEP - 0.1),
    ('Hesai: timestamp, s since 1970', 'timestamp', '<f8', 8, NOW + SWEEP, SWEEP),
    ('Livox: timestamp, ns since 1970', 'timestamp', '<f8', 8, (NOW + SWEEP) * 1e9, SWEEP),
    ('Livox: offset_time, ns', 'offset_time', '<u4', 6, SWEEP * 1e9, SWEEP),
    ('Autoware: time_stamp, ns', 'time_stamp', '<u4', 6, SWEEP * 1e9, SWEEP),
    ('microseconds', 't', '<u4', 6, SWEEP * 1e6, SWEEP),
    ('milliseconds as floats', 'time', '<f4', 7, SWEEP * 1e3, SWEEP),
    ('microseconds since 1970', 'timestamp', '<f8', 8, (NOW + SWEEP) * 1e6, SWEEP),
    ('a sweep of 20 Hz', 't', '<u4', 6, SWEEP * 0.5e9, SWEEP / 2),
    ('none is filled in', 't', '<u4', 6, SWEEP * 0, 'its driver does not fill it'),
    ('all are NaN', 'time', '<f4', 7, SWEEP * np.nan, 'is no number at any of the points seen'),
    ('GPS time, stamps of UTC', 'timestamp', '<f8', 8, NOW + 18 + SWEEP, '+18.0 s from the stamp'),
    ('since boot, stamps of UTC', 'timestamp', '<f8', 8, 5000 + SWEEP, 'another clock'),
    ('since 1970, cut to floats', 'timestamp', '<f4', 7, NOW + SWEEP, 'does not fill it'),
    ('columns are counted', 't', '<u4', 6, SWEEP * 10240, 'no sweep in s, ms, us or ns'),
    ('another name', 'intensity', '<f4', 7, SWEEP, 'its points tell no times'),
]  # fmt: skip


def timed(points, name, kind, datatype, values):
    """A cloud whose points have times."""
    cells = np.zeros(len(points), [('p', '<f4', 3), ('t', kind)])
    with np.errstate(invalid='ignore'):
        cells['p'], cells['t'] = points, values
    message = fill_point_cloud2(PointCloud2(), points, PointField)
    message.fields.append(PointField(name=name, offset=12, datatype=datatype, count=1))
    message.point_step, message.row_step = cells.itemsize, cells.nbytes
    message.data = array.array('B', cells.tobytes())
    message.header.stamp.sec = int(NOW)
    return message


@pytest.mark.parametrize('row', TIMES, ids=lambda row: row[0])
def test_point_times(row):
    """20 m/s straight on: points move by that times their time, or the 2 m of a sweep are left."""
    *field, expected = row[1:]
    poses = odometry.Odometry()
    for stamp in np.arange(NOW - 0.5, NOW + 0.5, 0.02):
        poses.add(float(stamp), se3.from_xyz_rpy(x=20 * (stamp - NOW)))
    scan = deskewed(timed(POINTS, *field), poses)
    if isinstance(expected, str):
        assert expected in scan.why
        assert scan.cloud is None
        np.testing.assert_allclose(scan.left, [2, 0, 0, 0, 0, 0], atol=0.01)
    else:
        assert not scan.why
        assert not scan.left.any()
        moved = scan.cloud.points - POINTS
        np.testing.assert_allclose(moved, np.outer(20 * expected, [1, 0, 0]), atol=1e-4)


# Name, the stamp, the node's clock when it comes, level and words of the diagnostics.
STAMPS = [
    ('as they should be', NOW, NOW + 0.2, OK, 'registering'),
    ('a little ahead', NOW, NOW - 0.3, OK, 'registering'),
    ('TAI', NOW, NOW - 36.8, WARN, '36.8 s ahead of the clock of the node: the sensor tells TAI'),
    ('GPS', NOW, NOW - 17.9, WARN, '17.9 s ahead of the clock of the node: the sensor tells GPS'),
    ('this one is on TAI', NOW, NOW + 37.1, WARN, 's behind the clock of the node: this machine'),
    ('local time, summer in Paris', NOW, NOW - 7199.8, WARN, 'local time, +2 h, in place of UTC?'),
    ('local time, St John\'s', NOW, NOW + 12600.3, WARN, 'local time, -3.5 h, in place of UTC?'),
    ('since boot', 4321.0, NOW, WARN, 'count from a start, of the sensor or of a simulation'),
    ('not set', 0.0, NOW, WARN, 'has stamps of 0: its driver does not set them'),
    ('a clock is off', NOW, NOW - 4.0, WARN, '4.0 s ahead of the clock of the node: are'),
    ('a way is slow', NOW, NOW + 7.0, WARN, '7.0 s behind the clock of the node: are'),
    ('a bag without use_sim_time', 1.3e9, NOW, WARN, '495000000 s behind the clock of the node'),
    ('use_sim_time without /clock', NOW, 0.0, WARN, 'use_sim_time is set, but does anybody'),
    ('a simulation', 12.0, 12.1, OK, 'registering'),
]  # fmt: skip


@pytest.mark.parametrize('row', STAMPS, ids=lambda row: row[0])
def test_stamps(row):
    """A clock that is off is never called slowness of the node."""
    _, stamp, clock, level, words = row
    health = Health()
    for side, frame in (('source', 'b'), ('target', 'a')):
        for _ in range(3):
            health.heard(side, frame, stamp, now=0.0, clock=clock)
    accepted = Registration(np.eye(4), 100, 200, '', {}, accepted=True)
    health.done(Outcome(accepted, clock + 0.3 - stamp, dt=0.0))
    found = health.judge(0.0, Limits(silence=2.0, max_age=5.0, max_pair_dt=0.1), 0.0)
    assert found[0] == level
    assert words in found[1]
    assert 's old' not in found[1]


@dataclass
class Vehicles:
    """Two standing vehicles over DDS: clouds with times, odometry at 20 Hz, nothing odd."""

    rig: object
    points: dict
    stamps: dict = field(default_factory=dict)  # seconds ahead of the clock, by topic
    frames: dict = field(default_factory=dict)
    change: Callable = lambda message: None  # of the source's clouds
    silent: set = field(default_factory=set)  # topics
    drive: float = 0.0  # metres a second, by the source's odometry
    until: float = 0.0  # odometry was sent
    began: float = field(default_factory=time.time)
    others: list = field(default_factory=list)  # nodes of other programs

    def publisher(self, topic, kind):
        """Made once for each topic, whatever rows come."""
        made = self.rig.publishers
        if topic not in made:
            made[topic] = self.rig.node.create_publisher(kind, f'/{topic}', QoSProfile(depth=30))
        return made[topic]

    def another(self, topic, kind=PointCloud2):
        """The publisher of another program on a topic, until the row ends."""
        context = Context()
        rclpy.init(context=context, domain_id=self.rig.domain)
        self.others.append(Node('other', context=context))
        return self.others[-1].create_publisher(kind, f'/{topic}', 1)

    def send(self):
        now = time.time()
        for stamp in np.arange(max(self.until, now - 1.0) + 0.05, now, 0.05):
            self.until = stamp
            for side in self.points:
                message = Odometry(child_frame_id=f'{side}_base')
                x = self.drive * (stamp - self.began) if side == 'source' else 0.0
                fill_pose(message.pose.pose, se3.from_xyz_rpy(x=x))
                self._publish(f'{side}/odometry', message, stamp)
        for points in self.points.values():
            points[0] += 0.001  # no two sweeps are the same
        for side, points in self.points.items():
            message = timed(points, 't', '<u4', 6, np.linspace(0, 1e8, len(points)))
            if side == 'source':
                self.change(message)
            self._publish(f'{side}/points', message, now - 0.25)

    def _publish(self, topic, message, stamp):
        if topic in self.silent:
            return
        stamp += self.stamps.get(topic, 0.0)
        message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), int(stamp % 1 * 1e9)
        message.header.frame_id = self.frames.get(topic, topic)
        self.publisher(topic, type(message)).publish(message)

    def end(self):
        for node in self.others:
            node.destroy_node()
            rclpy.shutdown(context=node.context)


def second_driver(frame):
    def alter(vehicles):
        other = vehicles.another('source/points')
        vehicles.frames['source/points'] = 'b'

        def change(message):
            message.header.stamp.sec, message.header.frame_id = int(time.time()), frame
            other.publish(message)
            time.sleep(0.2)  # the node takes one cloud at a time

        vehicles.change = change

    return alter


def wrong_type(vehicles):
    vehicles.silent = {'target/points'}
    vehicles.rig.node.destroy_publisher(vehicles.rig.publishers.pop('target/points'))
    vehicles.another('target/points', String)


def relayed(vehicles):
    vehicles.points['source'] = vehicles.points['target']


def setting(**values):
    def alter(vehicles):
        for name, value in values.items():
            setattr(vehicles, name, value)

    return alter


def message_with(**values):
    def change(message):
        for name, value in values.items():
            setattr(message, name, value)

    return setting(change=change)


def ahead(seconds, *topics):
    return setting(stamps=dict.fromkeys(topics, seconds))


CLOUDS, ODOMETRY = ('source/points', 'target/points'), ('source/odometry', 'target/odometry')
SKEWED = 'scans of source are not de-skewed: '
# Name, what is changed about two good vehicles, level and words of the diagnostics, and the figure
# `source de-skewed`, whatever else there is to say.
WIRING = [
    ('nothing', setting(), OK, 'registering', 'yes'),
    ('odometry stops', setting(silent={ODOMETRY[0]}), WARN, f'{SKEWED}odometry ends', 'no: odom'),
    ('two drivers', second_driver('c'), WARN, "source/points mixes the frames 'b', 'c'", 'yes'),
    ('two drivers, one frame', second_driver('b'), WARN,
     'source/points has 2 publishers on /source/points (/other, /vehicles)', 'yes'),
    ('no frame', setting(frames={CLOUDS[0]: ''}), WARN,
     'source/points has an empty frame_id', 'yes'),
    ('a slash in front', setting(frames={CLOUDS[1]: '/velo'}), WARN,
     "target/points has the frame '/velo'", 'yes'),
    ('one frame for both', setting(frames=dict.fromkeys(CLOUDS, 'velo')), WARN,
     "both clouds are in frame 'velo'", 'yes'),
    ('clouds in GPS time', ahead(18.0, *CLOUDS), WARN, 'the sensor tells GPS time', 'no: odom'),
    ('odometry in TAI', ahead(37.0, *ODOMETRY), WARN, 'target/odometry has stamps', 'no: odom'),
    ('all in TAI', ahead(37.0, *CLOUDS, *ODOMETRY), WARN, 'the sensor tells TAI', 'yes'),
    ('row_step is 0', message_with(row_step=0), OK, 'registering', 'yes'),
    ('height is 0', message_with(height=0), ERROR, 'is empty by its height 0', ''),
    ('no times', message_with(fields=cloud().fields), WARN,
     f'{SKEWED}its points tell no times', 'no: its points'),
    ('one cloud on both topics', relayed, ERROR, 'source and target are one cloud', ''),
    ('another type', wrong_type, WARN,
     '/other publishes std_msgs/msg/String on /target/points', ''),
]  # fmt: skip


def test_wiring(rig, meeting):
    """One node, fed row after row."""
    rig.add(
        RegistrarNode, registrar__headings=1, silence=1.0, motion__odometry=True, reliable=True
    )
    missed = {}
    for name, alter, level, words, figure in WIRING:
        clouds = {side: points.copy() for side, points in zip(SIDES, meeting, strict=False)}
        vehicles = Vehicles(rig, clouds)
        alter(vehicles)
        assert rig.trigger('reset').success

        def told(level=level, words=words, figure=figure):
            skewed = rig.figures().get('source de-skewed', '')
            at = rig.status and rig.status.level == bytes([level])
            return at and rig.says(words) and skewed.startswith(figure)

        if not rig.until(told, every=vehicles.send, pause=0.4, patience=20.0):
            missed[name] = rig.status.message, rig.figures()['source de-skewed']
        vehicles.end()
    assert not missed, missed


@pytest.mark.parametrize('kind', ['points', 'odometry'])
def test_inputs_that_are_one_topic_are_refused(rig, kind):
    names = [f'source/{kind}:=/lidar', f'target/{kind}:=/lidar']
    arguments = ['--ros-args', *(part for name in names for part in ('-r', name))]
    node = rig.add(RegistrarNode, cli_args=arguments, motion__odometry=True)
    assert rig.until(lambda: rig.says(f'source/{kind} and target/{kind} are both /lidar'))
    assert rig.status.level == bytes([ERROR])
    assert node.state == 'unconfigured'


def test_odometry_that_never_comes_is_told_of(rig):
    rig.add(RegistrarNode, registrar__headings=1, silence=1.0, motion__odometry=True)
    told = 'source/odometry silent for'
    assert rig.until(lambda: rig.says(told) and rig.says('nobody publishes on /source/odometry'))
    assert rig.status.level == bytes([WARN])


def test_odometry_that_contradicts_the_registrations_is_told_of(rig):
    """By its odometry the source drives off at 20 m/s; by every registration it stands."""
    tracking = Tracking(rig.node, MotionConfig(), source='source', prefix='~/')
    good = Registration(np.eye(4), 500, 900, '', {}, True, 0.99, np.eye(6) * 1e-3)
    limits = Limits(silence=1e9, max_age=1e9, max_pair_dt=0.1)
    words, found = 'registrations contradict the odometry', []
    for number in range(8):
        for side, speed in (('source', 20.0), ('target', 0.0)):
            message = Odometry()
            message.header.stamp.sec = number // 2
            message.header.stamp.nanosec = number % 2 * 500_000_000
            fill_pose(message.pose.pose, se3.from_xyz_rpy(x=speed * number / 2))
            tracking.topics[side].receive(message)
        tracking.registered(good, 'a', source=number / 2, target=number / 2)
        found.append(any(words in told for told in tracking.warnings(0.0, limits)))
    assert not any(found[:DISAGREE])
    assert found[-1]
    tracking.destroy()
