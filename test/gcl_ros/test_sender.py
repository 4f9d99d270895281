"""The sender over real DDS: what it sends, what it says, and whose motion it undoes."""

import os
import subprocess
import sys

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.types import PointCloud
from gcl_ros.compact_cloud import compact_cloud, is_compact
from gcl_ros.conversions import fill_point_cloud2, fill_pose, seconds
from gcl_ros.sender_node import SenderNode

STAMP, SPEED = 100.0, 20.0  # seconds, metres a second along x
FINE = CompactConfig(voxel_size=0.05, residual_bits=4)
WORLD = np.random.default_rng(0).uniform(-20, 20, (500, 3))
TIMES = np.linspace(0.0, 0.1, 500)  # seconds after the stamp


def raw(points) -> PointCloud2:
    message = fill_point_cloud2(PointCloud2(), points, PointField)
    message.header.frame_id, message.header.stamp.sec = 'lidar', int(STAMP)
    return message


def moving() -> PointCloud2:
    """A scan of 0.1 s on the move, whose points tell their times."""
    cells = np.zeros(len(WORLD), [('p', '<f4', 3), ('time', '<f4')])
    cells['p'] = WORLD - np.outer(TIMES * SPEED, [1, 0, 0])
    cells['time'] = TIMES
    message = raw(cells['p'])
    message.fields.append(PointField(name='time', offset=12, datatype=7, count=1))
    message.point_step, message.row_step = cells.itemsize, cells.nbytes
    message.data = cells.tobytes()
    return message


def drive(publisher, start, end):
    """Publish odometry at 100 Hz between two times after the stamp, seconds."""
    for after in np.arange(start, end, 0.01):
        message, stamp = Odometry(), STAMP + after
        message.header.stamp.sec = int(stamp)
        message.header.stamp.nanosec = int(stamp % 1 * 1e9)
        fill_pose(message.pose.pose, se3.from_xyz_rpy(x=SPEED * after))
        publisher.publish(message)


@pytest.fixture
def points(rig):
    return rig.node.create_publisher(PointCloud2, '/points', QoSProfile(depth=1))


def test_it_sends_the_scan_with_its_header(rig, points, meeting):
    rig.add(SenderNode)
    heard = rig.listen(PointCloud2, '/compact')
    send = lambda: points.publish(raw(meeting[0]))  # noqa: E731
    assert rig.until(lambda: heard, every=send)
    message = heard[0]
    assert is_compact(message)
    assert (message.header.frame_id, seconds(message.header.stamp)) == ('lidar', STAMP)
    expected = encode(PointCloud(meeting[0]))
    assert bytes(message.data) == expected
    assert len(expected) < 20_000
    assert rig.until(lambda: rig.says('sending'), every=send)
    figures = rig.figures()
    assert figures['points'] == str(len(meeting[0]))
    assert figures['bytes'] == str(len(expected))
    assert figures['voxels'] == str(len(decode(expected)))
    assert figures['de-skewed'] == 'no: odometry is off'


def test_it_says_what_is_wrong_and_lives(rig, points, meeting):
    rig.add(SenderNode, silence=1.0)
    heard = rig.listen(PointCloud2, '/compact')
    assert rig.until(lambda: rig.says('points silent for'))
    empty, far = raw(meeting[0][:0]), raw(meeting[0] + 1e4)
    assert rig.until(lambda: rig.says('is empty'), every=lambda: points.publish(empty))
    assert rig.until(lambda: rig.says('within 100 m'), every=lambda: points.publish(far))
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        assert rig.change(transition, 'sender')
    assert rig.until(lambda: rig.says('points silent for'))  # no longer what was wrong before
    assert not heard
    good = raw(meeting[0])
    assert rig.until(lambda: heard, every=lambda: points.publish(good))
    assert rig.until(lambda: rig.says('sending'), every=lambda: points.publish(good))


def test_a_compact_scan_is_not_made_compact_again(rig, points, meeting):
    rig.add(SenderNode)
    heard = rig.listen(PointCloud2, '/compact')
    assert rig.until(lambda: heard, every=lambda: points.publish(raw(meeting[0])))
    again = lambda: points.publish(heard[0])  # noqa: E731
    assert rig.until(lambda: rig.says("no field 'x'; it has gcl_compact_scan"), every=again)


def test_what_it_sends_changes_while_it_runs(rig, points, meeting):
    node = rig.add(SenderNode)
    heard = rig.listen(PointCloud2, '/compact')
    send = lambda: points.publish(raw(meeting[0]))  # noqa: E731
    assert rig.until(lambda: heard, every=send)
    fine = rig.set('voxel_size', 0.1, 'sender')
    assert fine.successful, fine.reason
    assert rig.until(lambda: len(heard[-1].data) > 1.5 * len(heard[0].data), every=send)
    refused = rig.set('voxel_size', 0.001, 'sender')
    assert not refused.successful
    assert node.config.voxel_size == 0.1


@pytest.mark.parametrize('late', [0.0, 0.05], ids=['odometry before the scan', 'and after it'])
def test_the_motion_during_a_scan_is_undone_before_it_is_sent(rig, points, late, monkeypatch):
    """The end of the sweep waits for its odometry, a little."""
    monkeypatch.setattr('gcl_ros.sender_node.PATIENCE', 30.0)
    rig.add(SenderNode, odometry=True, voxel_size=0.05, residual_bits=4, max_rate=1000.0)
    heard = rig.listen(PointCloud2, '/compact')
    wheels = rig.node.create_publisher(Odometry, '/odometry', 50)
    ends = [points, wheels]
    assert rig.until(lambda: all(p.get_subscription_count() for p in ends))
    drive(wheels, -0.05, 0.15 - 2 * late)
    assert rig.until(lambda: rig.figures().get('odometry') == 'received')
    points.publish(moving())
    if late:
        assert not rig.until(lambda: heard, patience=1.0)
        drive(wheels, 0.05, 0.15)
    assert rig.until(lambda: heard)
    sent = compact_cloud(heard[0]).points
    expected = decode(encode(PointCloud(WORLD.astype(np.float32)), FINE)).points
    apart = np.linalg.norm(sent[:, None] - expected[None], axis=2).min(1)
    assert np.quantile(apart, 0.95) < 0.02  # but for points that fell into the voxel beside
    assert rig.until(lambda: rig.figures().get('de-skewed') == 'yes')


def test_a_scan_whose_odometry_does_not_come_is_sent_as_it_is_and_that_is_said(rig, points):
    rig.add(SenderNode, odometry=True, voxel_size=0.05, residual_bits=4)
    heard = rig.listen(PointCloud2, '/compact')
    wheels = rig.node.create_publisher(Odometry, '/odometry', 50)

    def send():
        drive(wheels, -0.05, 0.05)
        points.publish(moving())

    assert rig.until(lambda: heard, every=send)
    as_it_came = encode(
        PointCloud((WORLD - np.outer(TIMES * SPEED, [1, 0, 0])).astype('f4')), FINE
    )
    assert bytes(heard[-1].data) == as_it_came
    assert rig.until(lambda: rig.says('scans are not de-skewed: odometry ends 0.0'), every=send)


def test_the_former_name_warns_and_sends(rig, points, tmp_path, meeting):
    heard = rig.listen(PointCloud2, '/compact')
    log = tmp_path / 'log'
    with log.open('w') as file:
        command = [sys.executable, '-m', 'gcl_ros.describer', '--ros-args', '-r', '__node:=old']
        running = subprocess.Popen(
            command, env=os.environ | {'ROS_DOMAIN_ID': str(rig.domain)}, stdout=file, stderr=file
        )
        try:
            send = lambda: points.publish(raw(meeting[0]))  # noqa: E731
            assert rig.until(lambda: heard, every=send), log.read_text()
        finally:
            running.terminate()
            running.wait(timeout=30)
    assert is_compact(heard[0])
    assert 'WARN' in log.read_text()
    assert 'use sender; its topic features is now compact' in log.read_text()
