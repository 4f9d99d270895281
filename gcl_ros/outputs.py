"""What the registrar publishes about an accepted pair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, TransformStamped
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import Correspondences, PointCloud, Registration
from gcl_ros.conversions import fill_point_cloud2, fill_pose, fill_transform, seconds
from gcl_ros.wire import header_of

MATCH_WIDTH = 0.05  # metres


@dataclass(frozen=True)
class Wanted:
    """What is published besides the transform and the pose.

    Attributes:
        tf: the transform on /tf.
        aligned: the source cloud in the target's frame.
        matches: the correspondences that agree, as lines.
    """

    tf: bool
    aligned: bool
    matches: bool


class Outputs:
    """Publishers of the registrar, made on configure and destroyed on cleanup.

    Args:
        node: to publish from.
        prefix: of the topics.
        wanted: what to publish.

    Raises:
        GclError: /tf is asked for where tf2_ros is not installed.
    """

    def __init__(self, node: Node, prefix: str, wanted: Wanted) -> None:
        self._node = node
        self._broadcaster = _tf_broadcaster(node) if wanted.tf else None
        create = node.create_publisher
        self._transform = create(TransformStamped, f'{prefix}transform', 10)
        self._pose = create(PoseWithCovarianceStamped, f'{prefix}pose', 10)
        self._aligned = create(PointCloud2, f'{prefix}aligned', 1) if wanted.aligned else None
        self._matches = create(Marker, f'{prefix}matches', 1) if wanted.matches else None

    @property
    def wants_matches(self) -> bool:
        """Whether somebody looks at the matches."""
        return self._matches is not None and self._matches.get_subscription_count() > 0

    def publish(self, result: Registration, *, source: Any, target: Any) -> None:
        """Publish an accepted registration.

        Args:
            result: with a transform.
            source: message; its frame becomes the child.
            target: message; its frame becomes the parent.
        """
        message = TransformStamped()
        later = max(source, target, key=lambda m: seconds(m.header.stamp))
        message.header = header_of(later)
        message.header.frame_id = target.header.frame_id
        message.child_frame_id = source.header.frame_id
        fill_transform(message.transform, result.T_target_source)
        self._transform.publish(message)
        if self._broadcaster is not None:
            self._broadcaster.sendTransform(message)
        if result.covariance is not None:
            pose = PoseWithCovarianceStamped(header=message.header)
            fill_pose(pose.pose.pose, result.T_target_source)
            pose.pose.covariance = result.covariance.ravel().astype(float)
            self._pose.publish(pose)

    def show(
        self,
        result: Registration,
        *,
        target: Any,
        cloud: PointCloud,
        matches: Correspondences | None,
    ) -> None:
        """Publish what people look at: both clouds as they came, in the target's frame and time.

        Args:
            result: with the transform between the clouds, whenever they were taken.
            target: message.
            cloud: points of the source.
            matches: correspondences that agree with the transform.
        """
        if self._aligned is not None:
            points = se3.transform(result.T_target_source, cloud.points)
            aligned = fill_point_cloud2(PointCloud2(), points, PointField)
            aligned.header = header_of(target)
            self._aligned.publish(aligned)
        if self._matches is not None and matches is not None:
            lines = _lines(header_of(target), result.T_target_source, matches)
            self._matches.publish(lines)

    def destroy(self) -> None:
        """Destroy the publishers."""
        for publisher in (self._transform, self._pose, self._aligned, self._matches):
            if publisher is not None:
                self._node.destroy_publisher(publisher)
        if self._broadcaster is not None:
            self._node.destroy_publisher(self._broadcaster.pub_tf)


def _tf_broadcaster(node: Node) -> Any:
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        raise GclError(
            'publish_tf needs tf2_ros, which comes with a ROS installation; install it or set '
            'publish_tf to false'
        ) from None
    return TransformBroadcaster(node)


def _lines(header: Header, T: np.ndarray, matches: Correspondences) -> Marker:
    """Lines from each source key point, as aligned, to its target key point raised by 5 m.

    Aligned, the two lie in one place: raised, the lines stand where the evidence is.
    """
    marker = Marker(header=header, ns='matches', type=Marker.LINE_LIST)
    marker.action = Marker.ADD
    marker.scale.x = MATCH_WIDTH
    marker.color.g, marker.color.a = 1.0, 0.8
    marker.pose.orientation.w = 1.0
    source = se3.transform(T, matches.source.double().numpy())
    target = matches.target.double().numpy() + [0.0, 0.0, 5.0]
    marker.points = [
        Point(x=x, y=y, z=z) for ends in zip(source, target, strict=True) for x, y, z in ends
    ]
    return marker
