"""The registrar with odometry over real DDS."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.types import Registration
from gcl_ros.conversions import fill_point_cloud2, fill_pose, matrix, pose_matrix, seconds
from gcl_ros.registrar_node import RegistrarNode
from gcl_ros.tracking import MotionConfig, Tracking

SPEED = {'source': 20.0, 'target': 10.0}  # metres a second, each along its own x
FAST = {'registrar__headings': 1, 'max_pair_dt': 0.4}
ODOMETRY = {'motion__odometry': True, 'motion__max_coast': 3.0}


class Wheels:
    """Sends the odometry of both vehicles, 10 Hz, up to a time."""

    def __init__(self, rig):
        self.rig, self.sent = rig, 0
        self.publishers = {
            side: rig.node.create_publisher(Odometry, f'/{side}/odometry', 50) for side in SPEED
        }

    def until(self, stamp):
        while self.sent / 10 < stamp:
            self.sent += 1
            for side, publisher in self.publishers.items():
                message = Odometry()
                message.header.stamp.sec, rest = divmod(self.sent, 10)
                message.header.stamp.nanosec = rest * 10**8
                fill_pose(message.pose.pose, se3.from_xyz_rpy(x=SPEED[side] * self.sent / 10))
                publisher.publish(message)


def moved(T, source, target):
    """The truth once the vehicles have driven on for so many seconds each."""
    back = se3.from_xyz_rpy(x=-SPEED['target'] * target)
    return back @ T @ se3.from_xyz_rpy(x=SPEED['source'] * source)


@pytest.fixture
def started(rig):
    rig.add(RegistrarNode, **FAST, **ODOMETRY)
    rig.publish_clouds()
    return rig


def test_clouds_of_different_times_are_brought_to_one(started, meeting):
    """The source's cloud is 0.3 s older: it has driven 6 m since."""
    rig, (source, target, T) = started, meeting
    rig.offset['source'] = -0.3
    wheels = Wheels(rig)
    transforms = rig.listen(TransformStamped, '/registrar/transform')

    def send():
        wheels.until(rig.stamp + 1.5)
        rig.send(source=source, target=target)

    expected = moved(T, 0.3, 0.0)
    right = lambda m: metrics.registered(matrix(m.transform), expected, metrics.STRICT)  # noqa: E731
    assert rig.until(lambda: any(right(m) for m in transforms), every=send), rig.status


def test_the_track_goes_on_between_registrations_and_ends(started, meeting):
    rig, (source, target, T) = started, meeting
    wheels = Wheels(rig)
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    track = rig.listen(PoseWithCovarianceStamped, '/registrar/track')
    wheels.until(2.0)
    rig.until(lambda: False, patience=0.5)
    assert rig.until(
        lambda: transforms, every=lambda: rig.send(source=source, target=target), pause=60.0
    )
    last = seconds(transforms[0].header.stamp)
    assert last == 1.0
    wheels.until(3.0)
    stamp = lambda: track and seconds(track[-1].header.stamp)  # noqa: E731
    assert rig.until(lambda: stamp() == pytest.approx(3.0))
    message = track[-1]
    assert message.header.frame_id == 'target_lidar'
    estimate = pose_matrix(message.pose.pose)
    assert metrics.registered(estimate, moved(T, 2.0, 2.0), metrics.STRICT)
    assert np.linalg.eigvalsh(np.reshape(message.pose.covariance, (6, 6))).min() > 0
    wheels.until(8.0)
    assert not rig.until(lambda: stamp() > 4.05, patience=1.0)  # 3 s without a registration
    assert stamp() == pytest.approx(4.0)
    assert rig.trigger('reset').success
    wheels.until(9.0)
    assert not rig.until(lambda: stamp() > 4.05, patience=0.5)


T_ACROSS = se3.from_xyz_rpy(x=20.0, yaw=np.pi / 2)
FOUND = Registration(T_ACROSS, 500, 900, '', {}, True, 0.99, np.eye(6) * 1e-4)


@pytest.fixture
def across(rig):
    """The source drives at 20 m/s across the target's x, until 1.95 s."""
    tracking = Tracking(rig.node, MotionConfig(), source='source', prefix='~/')
    for stamp in np.arange(0.0, 2.0, 0.05):
        for side, speed in (('source', 20.0), ('target', 0.0)):
            message = Odometry()
            message.header.stamp.sec, message.header.stamp.nanosec = (
                int(stamp),
                int(stamp % 1 * 1e9),
            )
            fill_pose(message.pose.pose, se3.from_xyz_rpy(x=speed * stamp))
            tracking.topics[side].receive(message)
    yield tracking
    tracking.destroy()


def deviations(covariance):
    return np.sqrt(np.diag(covariance)[:2])


def test_what_is_not_undone_is_in_the_deviation_of_pose_and_track(across):
    """A scan of 0.1 s whose points tell no times."""
    cloud = fill_point_cloud2(PointCloud2(), np.ones((5, 3), np.float32), PointField)
    cloud.header.stamp.sec = 1
    across.swept = {side: across.deskewed(side, cloud) for side in ('source', 'target')}
    result = across.registered(FOUND, 'target_lidar', source=1.0, target=1.0)
    for covariance in (result.covariance, across._filter.estimate.covariance):
        np.testing.assert_allclose(deviations(covariance), [0.01, 2.0], rtol=0.02)
    assert across.figures()['source de-skewed'].startswith('no: its points tell no times')
    assert float(across.figures()['track deviation m']) == pytest.approx(2.0, rel=0.02)


def test_the_way_between_two_stamps_is_in_the_deviation_where_odometry_is_late(across):
    result = across.registered(FOUND, 'target_lidar', source=1.95, target=2.05)
    np.testing.assert_array_equal(result.T_target_source, T_ACROSS)
    np.testing.assert_allclose(deviations(result.covariance), [0.01, 2.0], rtol=0.02)
    bridged = across.registered(FOUND, 'target_lidar', source=1.8, target=1.9)
    assert deviations(bridged.covariance).max() < 0.1
