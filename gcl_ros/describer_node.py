"""`ros2 run gcl_ros describer`: a PointCloud2 topic in, features of its scans out.

Subscribes: `points` (sensor_msgs/PointCloud2).
Publishes: `features` (sensor_msgs/PointCloud2, see `gcl_ros.feature_cloud`), with the header of
    the scan: 40 kB at 1,000 key points, where the scan has 2 MB. A `registrar` takes them in
    place of the points. `/diagnostics`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core.errors import GclError
from gcl_core.models import zoo
from gcl_core.models.backbone import Backbone
from gcl_ros import health, transport
from gcl_ros.conversions import point_cloud
from gcl_ros.diagnostics import Diagnostics, Report
from gcl_ros.feature_cloud import describe, fill_feature_cloud, weights_hash
from gcl_ros.lifecycle import ConfiguredNode
from gcl_ros.limits import MAX_POINTS, check_limits
from gcl_ros.rhythm import Throttle
from gcl_ros.wire import header_of, subscribe


@dataclass(frozen=True)
class DescriberConfig:
    """Parameters of the node.

    Attributes:
        autostart: configure and activate at start; otherwise wait for lifecycle transitions.
        weights: a shipped name or a file; the registrar must have the same.
        keypoints: most key points of a scan, spread evenly in space, most above the ground.
        turns: headings at which a scan is described. 1 is enough for a registrar that has the
            raw points of the other vehicle; where both come described, one side needs 4, or 12
            where streets have no clear direction. Time and size grow with it.
        max_rate: most scans described, in Hz; those in between are skipped.
        reliable: reliable subscription; it does not match best-effort publishers.
        silence: no cloud for this long is a warning in the diagnostics, seconds.
        max_points: clouds of more points are refused; it bounds memory and time.
    """

    autostart: bool = True
    weights: str = zoo.DEFAULT
    keypoints: int = 1000
    turns: int = 1
    max_rate: float = 10.0
    reliable: bool = False
    silence: float = 2.0
    max_points: int = MAX_POINTS


LIVE = ('keypoints', 'turns', 'max_rate', 'silence', 'max_points')


class DescriberNode(ConfiguredNode[DescriberConfig]):
    """Describes the newest scan in the callback: the queue is one scan deep."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('describer', DescriberConfig, **kwargs)
        self._model: Backbone[Any, Any] | None = None
        self._hash = ''
        self._publisher: Any = None
        self._input: Any = None
        self._heard = 0.0
        self._throttle = Throttle()
        self._figures: dict[str, str] = {}
        self._fault = ''
        self._diagnostics = Diagnostics(self, self._report, self.steady)

    def build(self, config: DescriberConfig) -> None:
        """Load the network and create the publisher."""
        self._model = zoo.load_weights(config.weights)
        self._model.dtype = zoo.best_dtype()
        self._hash = weights_hash(self._model)
        self._publisher = self.create_publisher(PointCloud2, 'features', 1)
        rmw = rclpy.get_rmw_implementation_identifier()
        if lost := transport.warning(rmw, reliable=config.reliable, read=transport.read_here()):
            self.get_logger().warning(lost)

    def begin(self) -> None:
        """Subscribe."""
        config = self.config
        policy = ReliabilityPolicy.RELIABLE if config.reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=1, reliability=policy)
        self._fault, self._figures, self._throttle = '', {}, Throttle()
        self._heard = time.monotonic()
        self._input = subscribe(self, PointCloud2, 'points', self._receive, self._refuse, qos)
        self.get_logger().info(f'ready; weights {config.weights} ({self._hash})')

    def end(self) -> None:
        """Unsubscribe."""
        if self._input is not None:
            self.destroy_subscription(self._input)
        self._input = None

    def release(self) -> None:
        """Let go of the network and the publisher."""
        if self._publisher is not None:
            self.destroy_publisher(self._publisher)
        self._publisher = self._model = None

    def live(self, name: str) -> bool:
        """Whether a parameter may change while the node is configured."""
        return name in LIVE

    def _receive(self, message: PointCloud2) -> None:
        self._heard = time.monotonic()
        if not self._throttle.passes(self._heard, self.config.max_rate):
            return
        try:
            features = self._describe(message)
        except GclError as error:
            self._refuse(str(error))
            return
        self._fault = ''
        self._publisher.publish(features)
        self._figures = {
            'key points': str(features.width),
            'headings': str(features.height),
            'bytes': str(len(features.data)),
            'total ms': f'{1e3 * (time.monotonic() - self._heard):.1f}',
        }

    def _refuse(self, reason: str) -> None:
        self._fault = reason
        self.get_logger().error(f'cloud left out: {reason}', throttle_duration_sec=5.0)

    def _describe(self, message: PointCloud2) -> PointCloud2:
        check_limits(message, self.config.max_points)
        cloud = point_cloud(message)
        described = describe(self._model, cloud, self.config.turns)
        features = fill_feature_cloud(
            PointCloud2(), described, self._hash, self.config.keypoints, PointField
        )
        features.header = header_of(message)
        return features

    def _report(self) -> list[Report]:
        figures = {'state': self.state, 'weights': self._hash, **self._figures}
        return [Report(*self._judge(time.monotonic() - self._heard), figures)]

    def _judge(self, silent: float) -> tuple[int, str]:
        """Level and message of the diagnostics, so many seconds after the last cloud."""
        if self.problem:
            return health.ERROR, f'{self.state}: {self.problem}'
        if self._input is None or self.config is None:
            return health.WARN, f'{self.state}, not active'
        if self._fault:
            return health.ERROR, f'last cloud left out: {self._fault}'
        if silent > self.config.silence:
            return health.WARN, f'points silent for {silent:.1f} s'
        return health.OK, 'describing'
