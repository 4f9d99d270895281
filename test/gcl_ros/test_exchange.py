"""Raw and described clouds in every combination, first as functions, then over real DDS."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_ros.conversions import fill_point_cloud2, matrix
from gcl_ros.describer_node import DescriberNode
from gcl_ros.exchange import Exchange, inverted_covariance
from gcl_ros.feature_cloud import describe, fill_feature_cloud, is_feature_cloud
from gcl_ros.registrar_node import RegistrarNode

TURN = se3.from_xyz_rpy(yaw=2.0)  # of the source: beyond what one heading bears


@pytest.fixture(scope='module')
def exchange():
    return Exchange(Registrar())


@pytest.fixture(scope='module')
def turned(meeting):
    """The source turned, the target, and the truth."""
    source, target, T = meeting
    return se3.transform(TURN, source), target, T @ se3.inverse(TURN)


def raw(points) -> PointCloud2:
    return fill_point_cloud2(PointCloud2(), points, PointField)


def described(exchange, points, turns) -> PointCloud2:
    found = describe(exchange.registrar.model, PointCloud(points), turns)
    return fill_feature_cloud(PointCloud2(), found, exchange.weights, 2000, PointField)


@pytest.mark.parametrize(
    ('source_turns', 'target_turns', 'found'),
    [(0, 0, True), (0, 1, True), (1, 0, True), (12, 1, True), (1, 12, True), (1, 1, False)],
)
def test_every_combination(exchange, turned, source_turns, target_turns, found):
    """Turns of 0 stand for a raw cloud. One heading each finds only what faces the same way."""
    source, target, T = turned
    messages = [
        described(exchange, points, turns) if turns else raw(points)
        for points, turns in ((source, source_turns), (target, target_turns))
    ]
    scans = [exchange.read(message) for message in messages]
    registered = exchange.register(source=scans[0], target=scans[1])
    result = registered.result
    assert result.accepted == found, result
    if found:
        assert metrics.registered(result.T_target_source, T, metrics.STRICT)
        matches = exchange.agreeing(registered)
        assert len(matches) > 20
        ends = se3.transform(result.T_target_source, matches.source.numpy())
        assert np.linalg.norm(ends - matches.target.numpy(), axis=1).max() < 1.0


def test_the_covariance_of_the_inverse_is_that_of_samples():
    rng = np.random.default_rng(0)
    T = se3.from_xyz_rpy(12, -5, 1, 0.1, -0.2, 2.0)
    root = rng.normal(size=(6, 6)) * [1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 1e-3]
    moves = rng.normal(size=(20_000, 6)) @ root
    inverse, errors = se3.inverse(T), np.empty_like(moves)
    for move, error in zip(moves, errors, strict=True):
        moved = se3.from_xyz_rpy(roll=move[3], pitch=move[4], yaw=move[5]) @ T
        moved[:3, 3] = T[:3, 3] + move[:3]
        back = se3.inverse(moved)
        turn = back[:3, :3] @ inverse[:3, :3].T
        error[:3] = back[:3, 3] - inverse[:3, 3]
        error[3:] = [turn[2, 1], turn[0, 2], turn[1, 0]]
    expected, found = np.cov(errors.T), inverted_covariance(T, root.T @ root)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((found - expected) / scale).max() < 0.05


def test_other_weights_and_handfuls_are_refused(exchange, turned):
    message = described(exchange, turned[0], 1)
    message.fields[4].name = 'gcl2_ffffffffffff'
    with pytest.raises(GclError, match='set the same weights on both vehicles'):
        exchange.read(message)
    with pytest.raises(GclError, match='has 900 points, 1000 are needed'):
        exchange.read(raw(turned[0][:900]))


def test_describer_to_registrar(rig, meeting):
    """A vehicle sends features only; the other has its own points and finds it."""
    source, target, T = meeting
    rig.add(DescriberNode, keypoints=2000)
    rig.add(RegistrarNode, registrar__turns=1)
    rig.publish_clouds()
    points = rig.node.create_publisher(PointCloud2, '/points', QoSProfile(depth=1))
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    poses = rig.listen(PoseWithCovarianceStamped, '/registrar/pose')

    def forward(features):
        assert is_feature_cloud(features)
        assert len(features.data) == 2000 * 40
        rig.publishers['source'].publish(features)

    rig.node.create_subscription(PointCloud2, '/features', forward, 1)

    def send():
        rig.send(target=target)
        message = raw(source)
        message.header.stamp.sec, message.header.frame_id = int(rig.stamp), 'source_lidar'
        points.publish(message)

    assert rig.until(lambda: transforms and poses, every=send), rig.status
    assert metrics.registered(matrix(transforms[0].transform), T, metrics.STRICT)
    assert transforms[0].child_frame_id == 'source_lidar'


def test_a_single_heading_is_looked_at_once(exchange, turned):
    """Both come described at one: a heading from memory offers nothing else."""
    source, target = (exchange.read(described(exchange, points, 1)) for points in turned[:2])
    registered = exchange.register(source=source, target=target, yaw=0.02)
    assert not registered.result.accepted
    assert registered.headings == 1


def test_describer_says_what_is_wrong_and_lives(rig, meeting):
    rig.add(DescriberNode, silence=1.0)
    points = rig.node.create_publisher(PointCloud2, '/points', QoSProfile(depth=1))
    features = rig.listen(PointCloud2, '/features')
    assert rig.until(lambda: rig.says('points silent for'))
    empty, far = raw(meeting[0][:0]), raw(meeting[0] + 1e4)
    assert rig.until(lambda: rig.says('is empty'), every=lambda: points.publish(empty))
    assert rig.until(lambda: rig.says('within 80 m'), every=lambda: points.publish(far))
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request()
        request.transition.id = transition
        assert rig.call(ChangeState, '/describer/change_state', request).success
    assert rig.until(lambda: rig.says('points silent for'))  # no longer what was wrong before
    assert not features
    good = raw(meeting[0])
    assert rig.until(lambda: features, every=lambda: points.publish(good))
    assert rig.until(lambda: rig.says('describing'), every=lambda: points.publish(good))
    assert rig.figures()['bytes'] == '40000'
