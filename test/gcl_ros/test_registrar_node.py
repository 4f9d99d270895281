"""The registrar over real DDS, whatever its topics do."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_ros.conversions import matrix, point_cloud, seconds
from gcl_ros.exchange import Exchange
from gcl_ros.registrar_node import RegistrarNode

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
FAST = {'registrar__headings': 1}
OK, WARN, ERROR = b'\0', b'\1', b'\2'


def streams(rig, meeting):
    """Function that sends the pair once more."""
    return lambda: rig.send(source=meeting[0], target=meeting[1])


def right(message, T) -> bool:
    return metrics.registered(matrix(message.transform), T, metrics.STRICT)


@pytest.mark.parametrize(
    ('publisher', 'reliable'), [(RELIABLE, False), (BEST_EFFORT, False), (RELIABLE, True)]
)
def test_publishes_transform_and_pose(rig, meeting, publisher, reliable):
    rig.add(RegistrarNode, **FAST, reliable=reliable)
    rig.publish_clouds(publisher)
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    poses = rig.listen(PoseWithCovarianceStamped, '/registrar/pose')
    assert rig.until(lambda: transforms and poses, every=streams(rig, meeting)), rig.status
    message = transforms[0]
    assert right(message, meeting[2])
    assert (message.header.frame_id, message.child_frame_id) == ('target_lidar', 'source_lidar')
    assert 1 <= seconds(message.header.stamp) <= rig.stamp
    pose = poses[0]
    assert pose.header == message.header
    assert pose.pose.pose.position.x == message.transform.translation.x
    assert pose.pose.pose.orientation == message.transform.rotation
    assert np.linalg.eigvalsh(pose.pose.covariance.reshape(6, 6)).min() > 0


def test_diagnostics_carry_every_figure(rig, meeting):
    rig.add(RegistrarNode, **FAST)
    rig.publish_clouds()
    send = streams(rig, meeting)
    behind = 'behind the clock of the node'  # these stamps are from 1970
    accepted = lambda: rig.figures().get('accepted', '0') != '0'  # noqa: E731
    assert rig.until(lambda: rig.says(behind) and accepted(), every=send)
    assert rig.status.level == WARN
    assert rig.status.name == 'registrar'
    figures = rig.figures()
    assert int(figures['accepted']) >= 1
    assert float(figures['probability']) > 0.9
    assert float(figures['distance m']) == pytest.approx(8.0, abs=1.0)
    wanted = {'age s', 'dt s', 'inliers', 'total ms', 'match ms', 'replaced by newer', 'left out'}
    assert wanted <= set(figures)


def test_the_likeliest_heading_is_enough(rig, meeting):
    turn = se3.from_xyz_rpy(yaw=2.0)
    source, target, T = se3.transform(turn, meeting[0]), meeting[1], meeting[2] @ se3.inverse(turn)
    rig.add(RegistrarNode, on_demand=True)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    send = lambda: rig.send(source=source, target=target)  # noqa: E731
    assert rig.until(lambda: rig.figures().get('pairs', '0') != '0', every=send)
    assert rig.trigger('trigger').success
    assert rig.until(lambda: len(transforms) == 1)
    assert right(transforms[-1], T)
    assert rig.until(lambda: rig.figures().get('headings') == '1')


def test_what_is_withheld_is_not_published_and_said(rig, meeting):
    node = rig.add(RegistrarNode, **FAST, registrar__min_probability=1.0)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    send = streams(rig, meeting)
    assert rig.until(lambda: rig.says('no transform: probability'), every=send)
    assert rig.status.level == WARN
    assert not transforms
    assert node.state == 'active'


def test_a_driver_that_hangs_is_told_of(rig, meeting):
    """One cloud with ever new stamps; the other vehicle's changes a little each time."""
    rig.add(RegistrarNode, **FAST, on_demand=True)
    rig.publish_clouds()
    drifting = meeting[1].copy()

    def send():
        drifting[-1] += 0.01
        rig.send(source=meeting[0], target=drifting)

    told = 'source/points sends one cloud again and again'
    assert rig.until(lambda: rig.says(told), every=send, pause=0.2)
    assert not rig.says('target/points sends')


def test_publishers_come_late_die_and_return(rig, meeting):
    rig.add(RegistrarNode, **FAST, silence=0.5)
    assert rig.until(lambda: rig.says('source/points silent'))
    assert rig.says('target/points silent')
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    assert rig.until(lambda: transforms, every=streams(rig, meeting))
    rig.node.destroy_publisher(rig.publishers.pop('target'))
    only_source = lambda: rig.send(source=meeting[0])  # noqa: E731
    assert rig.until(
        lambda: rig.says('target/points silent') and not rig.says('source/points silent'),
        every=only_source,
        pause=0.2,
    )
    assert rig.status.level == WARN
    rig.publish_clouds()
    late = rig.listen(TransformStamped, '/registrar/transform')  # a late joiner, too
    assert rig.until(lambda: late, every=streams(rig, meeting))
    assert right(late[0], meeting[2])


def test_stamps_that_jump_back_and_clocks_that_differ(rig, meeting):
    rig.add(RegistrarNode, **FAST)
    rig.publish_clouds()
    rig.stamp = 1000.0
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    send = streams(rig, meeting)
    assert rig.until(lambda: transforms, every=send)
    rig.stamp = 0.0  # the bag starts again
    assert rig.until(lambda: seconds(transforms[-1].header.stamp) < 900, every=send)
    assert rig.until(lambda: int(rig.figures().get('jumps back in time', 0)) >= 1)
    rig.offset['source'] = 3.25
    assert rig.until(lambda: rig.says('stamps +3.250 s apart'), every=send)

    def done():
        """No pair is at work any more."""
        of = {key: int(value) for key, value in rig.figures().items() if value.isdigit()}
        return of['pairs'] == of['accepted'] + of['withheld'] + of['replaced by newer']

    assert rig.until(done)
    pairs, count = rig.figures()['pairs'], len(transforms)
    send()
    assert not rig.until(lambda: len(transforms) > count, patience=1.5)
    assert rig.figures()['pairs'] == pairs


def test_malformed_clouds_do_no_harm(rig, meeting, malformed):
    """A thousand of them, paired; nothing is published, and the next good pair comes out."""
    node = rig.add(RegistrarNode, **FAST, reliable=True)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    assert rig.until(lambda: rig.publishers['source'].get_subscription_count())
    for seed in range(1000):
        if seed % 2:
            rig.send(source=malformed(seed), target=meeting[1][:2000])
        else:
            rig.send(source=malformed(seed), target=malformed(seed + 1))
        if seed % 50 == 0:
            rig.until(lambda: False, patience=0.1)
    assert rig.until(lambda: rig.status and rig.status.level == ERROR)
    assert int(rig.figures()['left out']) > 0
    assert node.state == 'active'
    assert not transforms
    assert rig.until(lambda: transforms, every=streams(rig, meeting)), rig.status
    assert right(transforms[0], meeting[2])


def test_trigger_answers_with_the_outcome_and_reset_forgets(rig, meeting):
    rig.add(RegistrarNode, **FAST, on_demand=True)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    answer = rig.trigger('trigger')
    assert not answer.success
    assert 'no pair of clouds has come yet' in answer.message
    ready = lambda: rig.status and rig.figures().get('pairs', '0') != '0'  # noqa: E731
    assert rig.until(ready, every=streams(rig, meeting))
    assert not transforms
    for count in (1, 2):
        answer = rig.trigger('trigger')
        assert answer.success
        assert 'probability' in answer.message
        assert rig.until(lambda count=count: len(transforms) == count)
    assert rig.trigger('reset').success
    assert not rig.trigger('trigger').success
    assert rig.until(lambda: rig.figures()['accepted'] == '0')


def test_what_is_at_work_is_forgotten_by_a_reset_too(rig, meeting, monkeypatch):
    register, reset = Exchange.register, []

    def interrupted(exchange, **pair):
        found = register(exchange, **pair)
        if not reset:
            reset.append(rig.trigger('reset').success)
        return found

    node = rig.add(RegistrarNode, **FAST, on_demand=True)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    ready = lambda: rig.figures().get('pairs', '0') != '0'  # noqa: E731
    assert rig.until(ready, every=streams(rig, meeting))
    monkeypatch.setattr(Exchange, 'register', interrupted)
    answer = rig.trigger('trigger')
    assert rig.until(lambda: reset)
    assert (answer.success, answer.message) == (False, 'reset: pairs were forgotten')
    assert not rig.until(lambda: transforms, patience=1.0)
    assert rig.figures()['accepted'] == '0'
    assert node.state == 'active'


def test_aligned_cloud_and_matches_on_request(rig, meeting):
    rig.add(RegistrarNode, publish_aligned=True, publish_matches=True, registrar__headings=4)
    rig.publish_clouds()
    aligned = rig.listen(PointCloud2, '/registrar/aligned')
    matches = rig.listen(Marker, '/registrar/matches')
    assert rig.until(lambda: aligned and matches, every=streams(rig, meeting))
    source, _, T = meeting
    expected = se3.transform(T, source)
    assert aligned[0].header.frame_id == matches[0].header.frame_id == 'target_lidar'
    assert np.median(np.linalg.norm(point_cloud(aligned[0]).points - expected, axis=1)) < 0.3
    ends = np.array([[p.x, p.y, p.z] for p in matches[0].points]).reshape(-1, 2, 3)
    assert len(ends) > 20
    assert np.linalg.norm((ends[:, 1] - ends[:, 0]) - [0, 0, 5], axis=1).max() <= 1.0
