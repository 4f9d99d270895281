"""What strangers send beyond any measure is refused, and the node goes on and says so."""

import array

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.compact.scan import CompactConfig, encode
from gcl_core.errors import GclError
from gcl_core.types import PointCloud
from gcl_ros import limits
from gcl_ros.compact_cloud import fill_compact
from gcl_ros.conversions import fill_point_cloud2, pose_matrix
from gcl_ros.limits import check_limits
from gcl_ros.odometry import KEPT
from gcl_ros.odometry import Odometry as Poses
from gcl_ros.registrar_node import RegistrarNode


def cloud(count=2000) -> PointCloud2:
    message = fill_point_cloud2(PointCloud2(), np.ones((count, 3)), PointField)
    message.header.frame_id = 'lidar'
    return message


def compact(count) -> PointCloud2:
    """A scan of so many voxels."""
    points = np.random.default_rng(0).uniform(-50, 50, (count, 3)).astype(np.float32)
    data = encode(PointCloud(points), CompactConfig(voxel_size=0.02))
    return fill_compact(cloud(10), data, PointField)


def with_fields(fields) -> PointCloud2:
    message = cloud()
    message.fields = fields
    return message


def named(name) -> PointCloud2:
    message = cloud()
    message.header.frame_id = name
    return message


def padded() -> PointCloud2:
    message = cloud(10)
    message.data = array.array('B', bytes(2001 * limits.MAX_POINT_BYTES))
    return message


@pytest.mark.parametrize(
    ('message', 'text'),
    [
        (cloud(2001), 'has 2001 points, 2000 are taken'),
        (compact(2001), 'has 2001 voxels, 2000 are taken; choose larger voxels there'),
        (with_fields([PointField(name='x')] * 65), '65 fields, 64 are taken'),
        (with_fields([PointField(name='x' * 300)]), 'name is over 255 characters'),
        (named('f' * 300), 'name has 300 characters, 255 are taken'),
        (padded(), 'carries 256128 bytes, 256000 are taken'),
    ],
)
def test_what_is_too_large_is_refused_with_the_limit(message, text):
    with pytest.raises(GclError, match=text):
        check_limits(message, max_points=2000)


def test_what_is_within_the_limits_is_taken():
    check_limits(cloud(2000), max_points=2000)
    check_limits(compact(2000), max_points=2000)


def test_odometry_that_floods_is_kept_up_to_a_number():
    poses = Poses()
    for number in range(limits.MAX_POSES + 500):
        poses.add(1.0 + 1e-6 * number, np.eye(4))
    assert len(poses._stamps) <= limits.MAX_POSES
    assert poses.at(1.0 + 1e-6 * (limits.MAX_POSES + 499)) is not None
    assert limits.MAX_POSES / KEPT > 300  # Hz: any odometry fits


@pytest.mark.parametrize('wrong', ['zero', 'nan', 'huge'])
def test_a_pose_that_is_none_is_refused(wrong):
    pose = Odometry().pose.pose
    pose.orientation.w = {'zero': 0.0, 'nan': float('nan'), 'huge': 1e200}[wrong]
    with pytest.raises(GclError, match='is no pose'):
        pose_matrix(pose)


def test_the_node_outlives_a_flood_and_says_what_it_refused(rig, meeting):
    rig.add(
        RegistrarNode,
        registrar__headings=1,
        motion__odometry=True,
        max_points=100_000,
        reliable=True,
    )
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    odometry = rig.node.create_publisher(Odometry, '/source/odometry', 10)
    nothing = Odometry()
    nothing.pose.pose.orientation.w = 0.0
    flood = cloud(100_001)

    def attack():
        rig.send(source=flood)
        odometry.publish(nothing)

    assert rig.until(lambda: rig.says('100001 points, 100000 are taken'), every=attack)
    assert rig.until(
        lambda: 'is no pose' in rig.figures().get('source odometry', ''), every=attack
    )
    send = lambda: rig.send(source=meeting[0], target=meeting[1])  # noqa: E731
    assert rig.until(lambda: transforms, every=send), rig.status
    T = se3.from_rotation_translation(
        se3.from_quaternion(*[getattr(transforms[0].transform.rotation, a) for a in 'xyzw']),
        np.array([getattr(transforms[0].transform.translation, a) for a in 'xyz']),
    )
    assert np.linalg.norm(T[:3, 3] - meeting[2][:3, 3]) < 0.6


@pytest.mark.parametrize(
    'payload', [b'\0\1\0\3', b'\0\0\300\177', b'', b'\0\1\0\0\377\377\377\377']
)
def test_bytes_that_are_no_message_do_no_harm(rig, payload):
    """Fast CDR reads past the first two and ends the process, most of the time."""
    rig.add(RegistrarNode, registrar__headings=1, motion__odometry=True)
    topics = {'/source/points': PointCloud2, '/source/odometry': Odometry}
    publishers = [rig.node.create_publisher(kind, name, 1) for name, kind in topics.items()]
    assert rig.until(lambda: all(p.get_subscription_count() for p in publishers))

    def send():
        for publisher in publishers:
            publisher.publish(payload)

    assert rig.until(lambda: rig.says('cannot read a message'), every=send, pause=0.1)
    assert rig.until(lambda: 'cannot read' in rig.figures().get('source odometry', ''), every=send)
    assert rig.figures()['state'] == 'active'
