"""The relative pose between registrations, at the rate of the vehicles' odometry.

Subscribes: `source/odometry`, `target/odometry` (nav_msgs/Odometry).
Publishes: `~/track` (geometry_msgs/PoseWithCovarianceStamped), until no registration has agreed
    with it for `max_coast` seconds.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import Registration
from gcl_ros.conversions import fill_pose, pose_matrix, seconds
from gcl_ros.deskew import SWEEP, Swept, deskewed
from gcl_ros.motion import LATELY, Drift, Relative, RelativeFilter, blurred, carried, difference
from gcl_ros.odometry import STILL, Odometry
from gcl_ros.pairing import JUMP, SIDES, Side
from gcl_ros.streams import Limits, Stream
from gcl_ros.wire import subscribe
from gcl_ros.wiring import wires

DISAGREE = 3  # registrations of the last ones that contradict odometry, before that is said

Mount = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class MotionConfig:
    """What the vehicles' odometry is used for.

    Attributes:
        odometry: subscribe to `source/odometry` and `target/odometry`; undo the motion during
            scans whose points tell their times, bring transforms to one time, publish `~/track`.
        source_mount: pose of the source's LiDAR in the frame that its odometry moves: x, y, z in
            metres, roll, pitch, yaw in radians; the same of every source.
        target_mount: likewise of the target's.
        sweep: seconds of a scan whose points do not tell their times; what a vehicle drives in it
            is part of the deviation. 0: scans come de-skewed, and nothing is undone.
        max_coast: seconds that `~/track` goes on without a registration that agrees with it.
        drift: how fast odometry goes wrong.
    """

    odometry: bool = False
    source_mount: Mount = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    target_mount: Mount = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    sweep: float = SWEEP
    max_coast: float = 5.0
    drift: Drift = field(default_factory=Drift)

    def __post_init__(self) -> None:
        if self.max_coast <= 0:
            raise GclError(f'motion.max_coast is {self.max_coast}; it must be positive (seconds)')


class Tracking:
    """Both odometries and the filter; callbacks and the worker share them under a lock.

    Args:
        node: to subscribe and publish from.
        config: see `MotionConfig`.
        source: prefix of the source's topic.
        prefix: of the topic published.
    """

    def __init__(self, node: Node, config: MotionConfig, *, source: str, prefix: str) -> None:
        self._node, self._config = node, config
        self._lock = threading.Lock()
        self._filter = RelativeFilter(config.drift)
        self._odometry: dict[Side, Odometry] = {
            'source': Odometry(se3.from_xyz_rpy(*config.source_mount)),
            'target': Odometry(se3.from_xyz_rpy(*config.target_mount)),
        }
        self._topics: dict[Side, str] = {
            'source': f'{source}/odometry',
            'target': 'target/odometry',
        }
        self._streams = self._listening()
        self.swept: dict[Side, Swept] = {}  # of the pair at work, or of the last
        self._refused: dict[Side, str] = {}
        self._frame = ''
        self._publisher = node.create_publisher(PoseWithCovarianceStamped, f'{prefix}track', 10)
        qos = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._inputs = [self._subscribe(side, qos) for side in SIDES]

    def _listening(self) -> dict[Side, Stream]:
        began = time.monotonic()
        kind = 'nav_msgs/msg/Odometry'
        return {side: Stream(topic, kind, began=began) for side, topic in self._topics.items()}

    def _subscribe(self, side: Side, qos: QoSProfile) -> Any:
        return subscribe(
            self._node,
            OdometryMessage,
            self._topics[side],
            partial(self._moved, side),
            partial(self._refuse, side),
            qos,
        )

    def _refuse(self, side: Side, reason: str) -> None:
        with self._lock:
            self._refused[side] = reason

    def _moved(self, side: Side, message: OdometryMessage) -> None:
        """Take a pose of one vehicle; publish as far as both are known."""
        header, clock = message.header, self._node.get_clock().now().nanoseconds * 1e-9
        frames = f'{header.frame_id} to {message.child_frame_id}'
        try:
            T = pose_matrix(message.pose.pose)
        except GclError as error:
            self._refuse(side, str(error))
            return
        stamp = seconds(header.stamp)
        with self._lock:
            self._refused.pop(side, None)
            self._streams[side].note(frames, stamp, now=time.monotonic(), clock=clock)
            self._odometry[side].add(stamp, T)
            newest = [odometry.newest for odometry in self._odometry.values()]
            estimate = self._filter.estimate
            if estimate is None or None in newest:
                return
            stamp = min(newest)
            if stamp < estimate.stamp - JUMP:
                self._filter.reset()
                return
            if stamp > estimate.stamp and self._filter.carry(stamp, **self._odometry):
                self._publish(self._filter.estimate)

    def _publish(self, estimate: Relative) -> None:
        if estimate.stamp - self._filter.confirmed > self._config.max_coast:
            return
        message = PoseWithCovarianceStamped()
        message.header.stamp.sec = int(estimate.stamp)
        message.header.stamp.nanosec = round(estimate.stamp % 1 * 1e9) % 10**9
        message.header.frame_id = self._frame
        fill_pose(message.pose.pose, estimate.T_target_source)
        message.pose.covariance = estimate.covariance.ravel()
        self._publisher.publish(message)

    def registered(
        self, result: Registration, frame: str, *, source: float, target: float
    ) -> Registration:
        """Bring an accepted registration to the later of the two stamps, and take it in.

        Its covariance grows by what the vehicles drove during scans that are not de-skewed, and
        between the stamps where odometry does not bridge them.

        Args:
            result: with a transform.
            frame: of the target's cloud.
            source: stamp of the source's cloud, seconds.
            target: stamp of the target's.
        """
        if result.T_target_source is None or result.covariance is None:
            return result
        left = {side: self.swept.get(side, Swept()).left for side in SIDES}
        covariance = blurred(result.T_target_source, result.covariance, **left)
        result = replace(result, covariance=covariance)
        stamp = max(source, target)
        with self._lock:
            own = self._odometry
            motions = {'source': STILL, 'target': STILL}
            if source != target:
                early: Side = 'source' if source < target else 'target'
                moved = own[early].moved(min(source, target), stamp)
                if moved is None:  # odometry is late or missing: as without it, and less certain
                    pace = own[early].pace(min(source, target), abs(source - target))
                    nothing = dict.fromkeys(SIDES, np.zeros(6))
                    left = (
                        nothing if pace is None else nothing | {early: difference(pace, np.eye(4))}
                    )
                    covariance = blurred(result.T_target_source, covariance, **left)
                    return replace(result, covariance=covariance)
                motions[early] = moved
            first = Relative(min(source, target), result.T_target_source, covariance)
            together = carried(first, stamp, **motions, drift=self._config.drift)
            self._frame = frame
            self._filter.update(together, **own)
        return replace(
            result, T_target_source=together.T_target_source, covariance=together.covariance
        )

    def heading_at(self, stamp: float) -> float | None:
        """Yaw of the relative pose, radians; None unless a registration agreed with it lately."""
        with self._lock:
            estimate = self._filter.estimate
            if estimate is None or stamp - self._filter.confirmed > self._config.max_coast:
                return None
            return se3.yaw(estimate.T_target_source)

    def deskewed(self, side: Side, message: Any) -> Swept:
        """Undo the vehicle's motion during a scan, as far as that can be done."""
        with self._lock:
            return deskewed(message, self._odometry[side], self._config.sweep)

    def reset(self) -> None:
        """Forget the estimate, and what there was to say."""
        with self._lock:
            self._filter.reset()
            self._streams, self.swept = self._listening(), {}

    def warnings(self, now: float, limits: Limits) -> list[str]:
        """Why odometry that is asked for is not used, or not to be trusted.

        Args:
            now: monotonic seconds.
            limits: when to warn.
        """
        limits = replace(limits, reliable=False)  # odometry is subscribed to best effort
        graph = {side: wires(self._node, topic) for side, topic in self._topics.items()}
        with self._lock:
            found = [f'{self._topics[side]} refused: {r}' for side, r in self._refused.items()]
            for side, stream in self._streams.items():
                found += stream.warnings(now, limits, graph[side])
            for side, swept in self.swept.items():
                if swept.why:
                    name = self._topics[side].removesuffix('/odometry')
                    found.append(f'scans of {name} are not de-skewed: {swept.why}')
            wrong = list(self._filter.agreed).count(False)
        if wrong >= DISAGREE:
            found.append(
                f'{wrong} of the last {LATELY} registrations contradict the odometry: is it of '
                'these vehicles, and are motion.source_mount and motion.target_mount right?'
            )
        return found

    def figures(self) -> dict[str, str]:
        """For the diagnostics."""
        with self._lock:
            estimate = self._filter.estimate
            rows = {'track contradicted by': str(self._filter.contradicted)}
            for side, odometry in self._odometry.items():
                rows[f'{side} odometry'] = 'none' if odometry.newest is None else 'received'
                if side in self._refused:
                    rows[f'{side} odometry'] = f'refused: {self._refused[side]}'
                rows[f'{side} de-skewed'] = _told(self.swept.get(side), self._config.sweep)
            if estimate is not None:
                deviation = float(np.sqrt(np.trace(estimate.covariance[:3, :3])))
                rows['track coasting s'] = f'{estimate.stamp - self._filter.confirmed:.2f}'
                rows['track deviation m'] = f'{deviation:.3f}'
            return rows

    def destroy(self) -> None:
        """Destroy subscriptions and publisher."""
        for subscription in self._inputs:
            self._node.destroy_subscription(subscription)
        self._node.destroy_publisher(self._publisher)


def _told(swept: Swept | None, sweep: float) -> str:
    """Whether scans are de-skewed, for the diagnostics."""
    if sweep == 0:
        return 'no: motion.sweep is 0, they come so'
    if swept is None:
        return 'no scan yet'
    if swept.why:
        return f'no: {swept.why}'
    return f'yes, but {swept.timeless} points have no time' if swept.timeless else 'yes'
