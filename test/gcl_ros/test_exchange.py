"""Raw and compact clouds in every mix, first as functions, then over real DDS."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core import se3
from gcl_core.compact.scan import CompactConfig, encode
from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_ros.compact_cloud import fill_compact
from gcl_ros.conversions import fill_point_cloud2, matrix
from gcl_ros.deskew import Swept
from gcl_ros.exchange import Exchange
from gcl_ros.registrar_node import RegistrarNode
from gcl_ros.sender_node import SenderNode

TURN = se3.from_xyz_rpy(yaw=2.0)  # of the source: beyond what one heading bears
MIXES = [(False, False), (False, True), (True, False), (True, True)]  # which sides are compact


@pytest.fixture(scope='module')
def exchange():
    made = Exchange(Registrar())
    yield made
    made.close()


@pytest.fixture(scope='module')
def turned(meeting):
    """The source turned, the target, and the truth."""
    source, target, T = meeting
    return se3.transform(TURN, source).astype(np.float32), target, T @ se3.inverse(TURN)


def raw(points) -> PointCloud2:
    return fill_point_cloud2(PointCloud2(), points, PointField)


def compact(points, **config) -> PointCloud2:
    return fill_compact(
        PointCloud2(), encode(PointCloud(points), CompactConfig(**config)), PointField
    )


@pytest.mark.parametrize('sent', MIXES)
def test_every_mix_at_any_heading(exchange, turned, sent):
    *clouds, T = turned
    messages = [
        compact(points) if small else raw(points)
        for points, small in zip(clouds, sent, strict=True)
    ]
    source, target = map(exchange.read, messages)
    registered = exchange.register(source=source, target=target)
    result = registered.result
    assert result.accepted, result
    assert metrics.registered(result.T_target_source, T, metrics.STRICT)
    matches = exchange.agreeing(registered)
    assert len(matches) > 20
    ends = se3.transform(result.T_target_source, matches.source.numpy())
    assert np.linalg.norm(ends - matches.target.numpy(), axis=1).max() < 1.0


@pytest.mark.parametrize('make', [raw, compact])
def test_handfuls_are_refused(exchange, turned, make):
    far_apart = np.random.default_rng(0).uniform(-40, 40, (900, 3)).astype(np.float32)
    with pytest.raises(GclError, match=r'has \d+ points, 1000 are needed'):
        exchange.read(make(far_apart))


def test_a_compact_scan_is_not_de_skewed_again(exchange, turned):
    """Nor is anything said of its motion, which its sender knew."""
    asked = []

    def deskew(message):
        asked.append(message)
        return Swept(why='there is no odometry', left=np.ones(6))

    sent, own = (exchange.read(make(turned[0]), deskew=deskew) for make in (compact, raw))
    assert len(asked) == 1
    assert own.swept.why
    assert not sent.swept.why
    assert not sent.swept.left.any()


@pytest.mark.parametrize('sent', MIXES)
def test_every_mix_over_dds(rig, turned, sent):
    """A sender on each side that is compact; the vehicles face each other at any heading."""
    rig.add(RegistrarNode)
    *clouds, T = turned
    points = dict(zip(('source', 'target'), clouds, strict=True))
    for side, small in zip(points, sent, strict=True):
        topic = f'/{side}/{"raw" if small else "points"}'
        rig.publishers[side] = rig.node.create_publisher(PointCloud2, topic, QoSProfile(depth=1))
        if small:
            names = {'points': topic, 'compact': f'/{side}/points', '__node': f'{side}_sender'}
            remapped = [part for pair in names.items() for part in ('-r', ':='.join(pair))]
            rig.add(SenderNode, cli_args=['--ros-args', *remapped])
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    poses = rig.listen(PoseWithCovarianceStamped, '/registrar/pose')
    assert rig.until(lambda: transforms and poses, every=lambda: rig.send(**points)), rig.status
    assert metrics.registered(matrix(transforms[0].transform), T, metrics.STRICT)
    ends = transforms[0].header.frame_id, transforms[0].child_frame_id
    assert ends == ('target_lidar', 'source_lidar')


def test_features_of_an_older_version_are_refused_in_plain_words(rig, meeting):
    """As an older `describer` sent them: one row of 40 bytes a key point."""
    rig.add(RegistrarNode, registrar__headings=1)
    rig.publish_clouds()
    shorts = [
        PointField(name=name, offset=2 * i, datatype=3, count=1)
        for i, name in enumerate(('x', 'y', 'z', 'turn'))
    ]
    hashed = PointField(name='gcl2_0123456789ab', offset=8, datatype=1, count=32)
    features = PointCloud2(height=1, width=1000, point_step=40, row_step=40_000)
    features.fields, features.data = [*shorts, hashed], bytes(40_000)
    send = lambda: rig.send(source=features, target=meeting[1])  # noqa: E731
    told = 'holds features, as `describer` of an older gcl_ros sent them'
    assert rig.until(lambda: rig.says(told), every=send)
    assert rig.says('install it on both vehicles and run `sender` there')
    assert rig.figures()['state'] == 'active'


def test_what_the_sender_could_not_undo_is_no_warning_here(rig, meeting):
    """Odometry of both sides would be there for raw scans."""
    rig.add(RegistrarNode, registrar__headings=1, motion__odometry=True)
    rig.publish_clouds()
    transforms = rig.listen(TransformStamped, '/registrar/transform')
    send = lambda: rig.send(source=compact(meeting[0]), target=raw(meeting[1]))  # noqa: E731
    assert rig.until(lambda: transforms, every=send)
    told = 'by its sender, whose diagnostics say whether'
    assert rig.until(lambda: rig.figures().get('source de-skewed') == told, every=send)
    assert rig.until(lambda: rig.says('scans of target are not de-skewed'), every=send)
    assert not rig.says('scans of source')
