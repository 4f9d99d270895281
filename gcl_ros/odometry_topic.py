"""One vehicle's odometry as it comes in: its poses, and what is odd about its topic."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_ros.conversions import pose_matrix, seconds
from gcl_ros.odometry import Odometry
from gcl_ros.streams import Limits, Stream
from gcl_ros.wire import subscribe
from gcl_ros.wiring import wires

Mount = tuple[float, float, float, float, float, float]
UNMOUNTED: Mount = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class OdometryTopic:
    """Subscribes to a topic of nav_msgs/Odometry and keeps its poses.

    Args:
        node: to subscribe from.
        name: of the topic.
        mount: pose of the LiDAR in the frame that the odometry moves: x, y, z in metres, roll,
            pitch, yaw in radians.
        lock: held while a pose is taken and `moved` is called.
        moved: called after each pose.

    Attributes:
        name: of the topic.
        poses: of the LiDAR.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        mount: Mount,
        *,
        lock: threading.Lock,
        moved: Callable[[], None],
    ) -> None:
        self.name, self.poses = name, Odometry(se3.from_xyz_rpy(*mount))
        self._node, self._lock, self._moved = node, lock, moved
        self._refused = ''
        self.reset()
        qos = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscription = subscribe(
            node, OdometryMessage, name, self.receive, self._refuse, qos
        )

    def receive(self, message: OdometryMessage) -> None:
        """Take a pose."""
        header, clock = message.header, self._node.get_clock().now().nanoseconds * 1e-9
        frames = f'{header.frame_id} to {message.child_frame_id}'
        try:
            T = pose_matrix(message.pose.pose)
        except GclError as error:
            self._refuse(str(error))
            return
        stamp = seconds(header.stamp)
        with self._lock:
            self._refused = ''
            self._stream.note(frames, stamp, now=time.monotonic(), clock=clock)
            self.poses.add(stamp, T)
            self._moved()

    def _refuse(self, reason: str) -> None:
        self._refused = reason

    def warnings(self, now: float, limits: Limits) -> list[str]:
        """Why it is not used, or not to be trusted.

        Args:
            now: monotonic seconds.
            limits: when to warn.
        """
        limits = replace(limits, reliable=False)  # it is subscribed to best effort
        graph = wires(self._node, self.name)
        with self._lock:
            refused = [f'{self.name} refused: {self._refused}'] if self._refused else []
            return refused + self._stream.warnings(now, limits, graph)

    def told(self) -> str:
        """Whether it comes, for the diagnostics."""
        if self._refused:
            return f'refused: {self._refused}'
        return 'none' if self.poses.newest is None else 'received'

    def reset(self) -> None:
        """Forget what there was to say of the topic."""
        self._stream = Stream(self.name, 'nav_msgs/msg/Odometry', began=time.monotonic())

    def destroy(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self._subscription)
