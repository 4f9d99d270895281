"""`ros2 run gcl_ros registrar`: two PointCloud2 topics in, their relative transform out.

Subscribes: `source/points`, `target/points` (sensor_msgs/PointCloud2).
Publishes: `~/transform` (geometry_msgs/TransformStamped), frame = the target's, child = the
    source's, stamp = the later of the pair's. Nothing is published when nothing is found.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from dataclasses import dataclass, field

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2

from gcl_core.errors import GclError
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_ros.conversions import fill_transform, point_cloud, seconds
from gcl_ros.pairing import Pairing
from gcl_ros.parameters import declare

REMIND = 30.0  # seconds between reminders that a misconfigured node does nothing


@dataclass(frozen=True)
class NodeConfig:
    """Parameters of the node.

    Attributes:
        max_pair_dt: largest difference of the two clouds' stamps, seconds.
        reliable: reliable subscriptions; they do not match best-effort publishers.
        registrar: what happens between two clouds and a transform.
    """

    max_pair_dt: float = 0.1
    reliable: bool = False
    registrar: RegistrarConfig = field(default_factory=RegistrarConfig)


class RegistrarNode(Node):
    """Callbacks take the newest clouds; one worker thread registers them.

    A node whose parameters or weights are wrong says so, stays alive and publishes nothing.
    """

    def __init__(self, **kwargs: object) -> None:
        super().__init__('registrar', **kwargs)
        self._pairing: Pairing[PointCloud2] | None = None
        self._worker: threading.Thread | None = None
        try:
            self._config = declare(self, NodeConfig)
            self._registrar = Registrar(self._config.registrar)
        except GclError as error:
            message = f'not configured, nothing will be published: {error}'
            self.get_logger().error(message)
            self.create_timer(REMIND, lambda: self.get_logger().error(message))
            return
        self._start()

    def _start(self) -> None:
        config = self._config
        self._pairing = Pairing(config.max_pair_dt)
        self._publisher = self.create_publisher(TransformStamped, '~/transform', 10)
        policy = ReliabilityPolicy.RELIABLE if config.reliable else ReliabilityPolicy.BEST_EFFORT
        # Depth 1: at depth 10 a busy subscriber reads clouds that are seconds old.
        qos = QoSProfile(depth=1, reliability=policy)
        for side in ('source', 'target'):
            self.create_subscription(
                PointCloud2,
                f'{side}/points',
                lambda message, side=side: self._receive(side, message),
                qos,
            )
        if not config.reliable and 'FASTDDS_DEFAULT_PROFILES_FILE' not in os.environ:
            self.get_logger().warning(
                'Fast DDS loses best-effort clouds over 512 kB with its default transport; set '
                'FASTDDS_DEFAULT_PROFILES_FILE to config/fastdds.xml, or reliable:=true'
            )
        self._worker = threading.Thread(target=self._work, name='registrar', daemon=True)
        self._worker.start()
        self.get_logger().info(f'ready; weights {config.registrar.weights}')

    def _receive(self, side: str, message: PointCloud2) -> None:
        self._pairing.add(side, seconds(message.header.stamp), message)

    def _work(self) -> None:
        while (pair := self._pairing.take()) is not None:
            try:
                self._register(*pair)
            except GclError as error:
                self.get_logger().error(f'pair left out: {error}')
            except Exception as error:  # the worker must outlive any one pair
                if self.context.ok():
                    self.get_logger().error(f'pair left out, please report: {error!r}')

    def _register(self, source: PointCloud2, target: PointCloud2) -> None:
        result = self._registrar.register(source=point_cloud(source), target=point_cloud(target))
        if not result.accepted:
            self.get_logger().info(f'no transform: {result.reason}, {result.ms["total"]:.0f} ms')
            return
        later = max(source, target, key=lambda message: seconds(message.header.stamp))
        message = TransformStamped()
        message.header.stamp = later.header.stamp
        message.header.frame_id = target.header.frame_id
        message.child_frame_id = source.header.frame_id
        fill_transform(message.transform, result.T_target_source)
        self._publisher.publish(message)
        self.get_logger().info(
            f'probability {result.probability:.4f}, {result.ms["total"]:.0f} ms'
        )

    def destroy_node(self) -> None:
        """Stop the worker, then the node."""
        if self._pairing is not None:
            self._pairing.close()
        if self._worker is not None:
            self._worker.join(timeout=10.0)
        super().destroy_node()


def main() -> None:
    """Run the node until Ctrl-C or SIGTERM.

    The handlers are our own: rclpy's shut the context down under a node that is being built.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO):
        node = RegistrarNode()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.2)
        node.destroy_node()


if __name__ == '__main__':
    main()
