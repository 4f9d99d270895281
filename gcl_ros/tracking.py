"""The relative pose between registrations, at the rate of the vehicles' odometry.

Subscribes: `source/odometry`, `target/odometry` (nav_msgs/Odometry).
Publishes: `~/track` (geometry_msgs/PoseWithCovarianceStamped), until no registration has agreed
    with it for `max_coast` seconds.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node

from gcl_core.errors import GclError
from gcl_core.types import Registration
from gcl_ros.conversions import fill_pose
from gcl_ros.deskew import SWEEP, Swept, deskewed
from gcl_ros.motion import LATELY, Drift, Relative, RelativeFilter, blurred, carried, difference
from gcl_ros.odometry import STILL, Odometry
from gcl_ros.odometry_topic import UNMOUNTED, Mount, OdometryTopic
from gcl_ros.pairing import JUMP, SIDES, Side
from gcl_ros.streams import Limits

DISAGREE = 3  # registrations of the last ones that contradict odometry, before that is said


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
    source_mount: Mount = UNMOUNTED
    target_mount: Mount = UNMOUNTED
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
        self.swept: dict[Side, Swept] = {}  # of the pair at work, or of the last
        self._frame = ''
        self._publisher = node.create_publisher(PoseWithCovarianceStamped, f'{prefix}track', 10)
        names = {'source': source, 'target': 'target'}
        mounts = {'source': config.source_mount, 'target': config.target_mount}
        self._odometry: dict[Side, Odometry] = {}
        self.topics: dict[Side, OdometryTopic] = {}
        for side in SIDES:
            self.topics[side] = OdometryTopic(
                node, f'{names[side]}/odometry', mounts[side], lock=self._lock, moved=self._moved
            )
            self._odometry[side] = self.topics[side].poses

    def _moved(self) -> None:
        """Publish as far as both are known, after a pose of one; the lock is held."""
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

    def deskewed(self, side: Side, message: Any) -> Swept:
        """Undo the vehicle's motion during a scan, as far as that can be done."""
        with self._lock:
            return deskewed(message, self._odometry[side], self._config.sweep)

    def reset(self) -> None:
        """Forget the estimate, and what there was to say."""
        with self._lock:
            self._filter.reset()
            self.swept = {}
            for topic in self.topics.values():
                topic.reset()

    def warnings(self, now: float, limits: Limits) -> list[str]:
        """Why odometry that is asked for is not used, or not to be trusted.

        Args:
            now: monotonic seconds.
            limits: when to warn.
        """
        found = [odd for side in SIDES for odd in self.topics[side].warnings(now, limits)]
        with self._lock:
            for side, swept in self.swept.items():
                if swept.why:
                    name = self.topics[side].name.removesuffix('/odometry')
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
            for side, topic in self.topics.items():
                rows[f'{side} odometry'] = topic.told()
                rows[f'{side} de-skewed'] = _told(self.swept.get(side), self._config.sweep)
            if estimate is not None:
                deviation = float(np.sqrt(np.trace(estimate.covariance[:3, :3])))
                rows['track coasting s'] = f'{estimate.stamp - self._filter.confirmed:.2f}'
                rows['track deviation m'] = f'{deviation:.3f}'
            return rows

    def destroy(self) -> None:
        """Destroy subscriptions and publisher."""
        for topic in self.topics.values():
            topic.destroy()
        self._node.destroy_publisher(self._publisher)


def _told(swept: Swept | None, sweep: float) -> str:
    """Whether scans are de-skewed, for the diagnostics."""
    if swept is None:
        return 'no scan yet'
    if sweep == 0 and not swept.by_sender:
        return 'no: motion.sweep is 0, they come so'
    return swept.told()
