"""`ros2 run gcl_ros sender`: a PointCloud2 topic in, compact scans out.

Subscribes: `points` (sensor_msgs/PointCloud2); with `odometry` also `odometry`
    (nav_msgs/Odometry), by which scans are de-skewed before they are sent.
Publishes: `compact` (sensor_msgs/PointCloud2, see `gcl_ros.compact_cloud`), with the header of the
    scan: 10 kB, where the scan has 2 MB. A `registrar` takes them in place of the points.
    `/diagnostics`.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core.compact.scan import CompactConfig, encode, read_header
from gcl_core.errors import GclError
from gcl_ros import health, transport
from gcl_ros.compact_cloud import fill_compact
from gcl_ros.conversions import point_cloud
from gcl_ros.deskew import Swept, deskewed
from gcl_ros.diagnostics import Diagnostics, Report
from gcl_ros.lifecycle import ConfiguredNode
from gcl_ros.limits import MAX_POINTS, check_limits
from gcl_ros.odometry_topic import UNMOUNTED, Mount, OdometryTopic
from gcl_ros.rhythm import Throttle
from gcl_ros.streams import Limits
from gcl_ros.wire import header_of, subscribe
from gcl_ros.wiring import wires

PATIENCE = 0.05  # seconds that a scan waits for odometry that is on its way
TICK = 0.02  # seconds between looks at whether it has waited long enough
KIND = 'sensor_msgs/msg/PointCloud2'
MAX_AGE = 5.0  # seconds that stamps of odometry may lie behind the clock of the node


@dataclass(frozen=True)
class SenderConfig:
    """Parameters of the node.

    Attributes:
        autostart: configure and activate at start; otherwise wait for lifecycle transitions.
        voxel_size: edge of the voxels that a scan is sent as, metres; the size of what is sent
            grows as it shrinks.
        max_range: points farther from the sensor are not sent, metres.
        residual_bits: bits an axis for where in its voxel the points are; 0 for its centre.
        max_rate: most scans sent, in Hz; those in between are skipped.
        odometry: subscribe to `odometry` and undo the motion during scans whose points tell their
            times. Leave it off where scans come de-skewed.
        mount: pose of the LiDAR in the frame that the odometry moves: x, y, z in metres, roll,
            pitch, yaw in radians.
        reliable: reliable subscription; it does not match best-effort publishers.
        silence: no cloud for this long is a warning in the diagnostics, seconds.
        max_points: clouds of more points are refused; it bounds memory and time.
    """

    autostart: bool = True
    voxel_size: float = 0.25
    max_range: float = 100.0
    residual_bits: int = 0
    max_rate: float = 10.0
    odometry: bool = False
    mount: Mount = UNMOUNTED
    reliable: bool = False
    silence: float = 2.0
    max_points: int = MAX_POINTS

    def __post_init__(self) -> None:
        _ = self.compact  # refuses what cannot be sent

    @property
    def compact(self) -> CompactConfig:
        """How much of a scan is sent."""
        return CompactConfig(self.voxel_size, self.max_range, self.residual_bits)


LIVE = ('voxel_size', 'max_range', 'residual_bits', 'max_rate', 'silence', 'max_points')


class Late(NamedTuple):
    """A scan that waits for odometry.

    Attributes:
        message: sensor_msgs/PointCloud2.
        came: when, monotonic seconds.
        awaits: stamp that odometry has to reach, seconds.
    """

    message: Any
    came: float
    awaits: float


class SenderNode(ConfiguredNode[SenderConfig]):
    """Sends the newest scan in the callback: the queue is one scan deep."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('sender', SenderConfig, **kwargs)
        self._publisher: Any = None
        self._input: Any = None
        self._odometry: OdometryTopic | None = None
        self._ticking: Any = None
        self._late: Late | None = None
        self._swept = Swept()  # what became of the motion during the last scan sent
        self._heard = 0.0
        self._throttle = Throttle()
        self._figures: dict[str, str] = {}
        self._fault = ''
        self._diagnostics = Diagnostics(self, self._report, self.steady)

    def build(self, config: SenderConfig) -> None:
        """Create the publisher."""
        self._publisher = self.create_publisher(PointCloud2, 'compact', 1)
        rmw = rclpy.get_rmw_implementation_identifier()
        if lost := transport.warning(rmw, reliable=config.reliable, read=transport.read_here()):
            self.get_logger().warning(lost)

    def begin(self) -> None:
        """Subscribe."""
        config = self.config
        policy = ReliabilityPolicy.RELIABLE if config.reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=1, reliability=policy)
        self._fault, self._figures, self._throttle = '', {}, Throttle()
        self._swept, self._heard = Swept(), time.monotonic()
        if config.odometry:
            lock = threading.Lock()
            self._odometry = OdometryTopic(
                self, 'odometry', config.mount, lock=lock, moved=self._moved
            )
            self._ticking = self.create_timer(TICK, self._tick, clock=self.steady)
        self._input = subscribe(self, PointCloud2, 'points', self._receive, self._refuse, qos)
        self.get_logger().info(f'ready; voxels of {config.voxel_size:g} m')

    def end(self) -> None:
        """Unsubscribe."""
        if self._input is not None:
            self.destroy_subscription(self._input)
        if self._odometry is not None:
            self._odometry.destroy()
        if self._ticking is not None:
            self.destroy_timer(self._ticking)
        self._input = self._odometry = self._ticking = self._late = None

    def release(self) -> None:
        """Let go of the publisher."""
        if self._publisher is not None:
            self.destroy_publisher(self._publisher)
        self._publisher = None

    def live(self, name: str) -> bool:
        """Whether a parameter may change while the node is configured."""
        return name in LIVE

    def _receive(self, message: PointCloud2) -> None:
        self._heard = time.monotonic()
        if not self._throttle.passes(self._heard, self.config.max_rate):
            return
        self._send_late()
        try:
            check_limits(message, self.config.max_points)
            swept = self._deskewed(message)
            if swept.awaits is None:
                self._send(message, swept, self._heard)
            else:
                self._late = Late(message, self._heard, swept.awaits)
        except GclError as error:
            self._refuse(str(error))

    def _moved(self) -> None:
        """Send the scan that waits if odometry has reached its end."""
        if self._late is not None and self._odometry.poses.newest >= self._late.awaits:
            self._send_late()

    def _tick(self) -> None:
        """Send the scan that waits as it came if it has waited long enough."""
        if self._late is not None and time.monotonic() - self._late.came >= PATIENCE:
            self._send_late()

    def _send_late(self) -> None:
        late, self._late = self._late, None
        if late is None:
            return
        try:
            self._send(late.message, self._deskewed(late.message), late.came)
        except GclError as error:
            self._refuse(str(error))

    def _deskewed(self, message: PointCloud2) -> Swept:
        return Swept() if self._odometry is None else deskewed(message, self._odometry.poses)

    def _send(self, message: PointCloud2, swept: Swept, came: float) -> None:
        data = encode(swept.cloud or point_cloud(message), self.config.compact)
        sent = fill_compact(PointCloud2(), data, PointField)
        sent.header = header_of(message)
        self._publisher.publish(sent)
        self._fault, self._swept = '', swept
        self._figures = {
            'points': str(message.width * message.height),
            'voxels': str(read_header(data).count),
            'bytes': str(len(data)),
            'total ms': f'{1e3 * (time.monotonic() - came):.1f}',
        }

    def _refuse(self, reason: str) -> None:
        self._fault = reason
        self.get_logger().error(f'cloud left out: {reason}', throttle_duration_sec=5.0)

    def _report(self) -> list[Report]:
        figures = {'state': self.state, **self._figures}
        if self._odometry is None:
            figures['de-skewed'] = 'no: odometry is off'
        else:
            figures['odometry'] = self._odometry.told()
            figures['de-skewed'] = self._swept.told() if self._figures else 'no scan yet'
        return [Report(*self._judge(time.monotonic()), figures)]

    def _judge(self, now: float) -> tuple[int, str]:
        """Level and message of the diagnostics."""
        if self.problem:
            return health.ERROR, f'{self.state}: {self.problem}'
        if self._input is None or self.config is None:
            return health.WARN, f'{self.state}, not active'
        if self._fault:
            return health.ERROR, f'last cloud left out: {self._fault}'
        if warnings := self._warnings(now):
            return health.WARN, '; '.join(warnings)
        return health.OK, 'sending'

    def _warnings(self, now: float) -> list[str]:
        config, found = self.config, []
        if (silent := now - self._heard) > config.silence:
            why = wires(self, 'points').silent(KIND, config.reliable)
            found.append(f'points silent for {silent:.1f} s: {why}')
        if self._odometry is not None:
            bounds = Limits(config.silence, max_age=MAX_AGE, max_pair_dt=0.0)
            found += self._odometry.warnings(now, bounds)
            if self._swept.why:
                found.append(f'scans are not de-skewed: {self._swept.why}')
        return found
