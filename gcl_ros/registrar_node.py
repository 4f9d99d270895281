"""`ros2 run gcl_ros registrar`: two PointCloud2 topics in, their relative transform out.

Subscribes: `source/points`, `target/points` (sensor_msgs/PointCloud2), raw or from `describer`.
Publishes: `~/transform` (geometry_msgs/TransformStamped), `~/pose`
    (geometry_msgs/PoseWithCovarianceStamped), both with frame = the target's, child = the
    source's, stamp = the later of the pair's; nothing when nothing is accepted. `/diagnostics`.
    If asked for, `/tf`, `~/aligned` (sensor_msgs/PointCloud2) and `~/matches`
    (visualization_msgs/Marker); with odometry `~/track`, see `gcl_ros.tracking`.
Serves: `~/trigger` (std_srvs/Trigger) registers the newest pair, `~/reset` forgets all pairs.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import Registration
from gcl_ros import health, transport
from gcl_ros.conversions import seconds
from gcl_ros.diagnostics import Diagnostics, Report
from gcl_ros.exchange import Exchange, Registered, Scan
from gcl_ros.lifecycle import ConfiguredNode, run
from gcl_ros.outputs import Outputs
from gcl_ros.pairing import Pairing, Side
from gcl_ros.tracking import MotionConfig, Tracking
from gcl_ros.worker import Worker


@dataclass(frozen=True)
class NodeConfig:
    """Parameters of the node.

    Attributes:
        autostart: configure and activate at start; otherwise wait for lifecycle transitions.
        max_pair_dt: clouds whose stamps differ by more than this are no pair, seconds.
        reliable: reliable subscriptions; they do not match best-effort publishers.
        on_demand: register a pair only when `~/trigger` is called.
        silence: a topic without a cloud for this long is a warning in the diagnostics, seconds.
        max_age: a transform this long after its stamp is a warning in the diagnostics, seconds.
        publish_tf: broadcast the transform on /tf too. The source's frame must have no other
            parent; needs tf2_ros.
        publish_aligned: publish the source cloud in the target's frame on `~/aligned`.
        publish_matches: publish the correspondences that agree as lines on `~/matches`.
        motion: what the vehicles' odometry is used for.
        registrar: what happens between two clouds and a transform.
    """

    autostart: bool = True
    max_pair_dt: float = 0.1
    reliable: bool = False
    on_demand: bool = False
    silence: float = 2.0
    max_age: float = 5.0
    publish_tf: bool = False
    publish_aligned: bool = False
    publish_matches: bool = False
    motion: MotionConfig = field(default_factory=MotionConfig)
    registrar: RegistrarConfig = field(default_factory=RegistrarConfig)


LIVE = ('max_pair_dt', 'on_demand', 'silence', 'max_age')  # and the registrar's, but the weights


class RegistrarNode(ConfiguredNode[NodeConfig]):
    """Callbacks take the newest clouds; one worker thread registers them."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('registrar', NodeConfig, **kwargs)
        self._exchange: Exchange | None = None
        self._outputs: Outputs | None = None
        self._pairing: Pairing[PointCloud2] | None = None
        self._worker: Worker[PointCloud2] | None = None
        self._tracking: Tracking | None = None
        self._inputs: list[Any] = []
        self._asked: list[Future] = []
        self._health = health.Health()
        self.create_service(Trigger, '~/trigger', self._trigger)
        self.create_service(Trigger, '~/reset', self._reset)
        self._diagnostics = Diagnostics(self, self._report, self.steady)

    def build(self, config: NodeConfig) -> None:
        """Load the network and create the publishers."""
        self._exchange = Exchange(Registrar(config.registrar))
        self._outputs = Outputs(
            self,
            tf=config.publish_tf,
            aligned=config.publish_aligned,
            matches=config.publish_matches,
        )
        rmw = rclpy.get_rmw_implementation_identifier()
        if lost := transport.warning(rmw, reliable=config.reliable):
            self.get_logger().warning(lost)

    def begin(self) -> None:
        """Subscribe and start the worker."""
        config = self.config
        self._health = health.Health(began=time.monotonic())
        self._pairing = Pairing(config.max_pair_dt, on_demand=config.on_demand)
        if config.motion.odometry:
            self._tracking = Tracking(self, config.motion)
        self._worker = Worker(self._pairing, self._register, self._left_out)
        policy = ReliabilityPolicy.RELIABLE if config.reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=1, reliability=policy)  # deeper, and clouds grow seconds old
        self._inputs = [subscribe(self, side, self._receive, qos) for side in ('source', 'target')]
        self.get_logger().info(f'ready; weights {config.registrar.weights}')

    def end(self) -> None:
        """Unsubscribe and let the worker finish its pair, which is not published any more."""
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        self._inputs = []
        if self._worker is not None:
            self._worker.stop()
            self._worker = self._pairing = None
        if self._tracking is not None:
            self._tracking.destroy()
            self._tracking = None
        self._answer(False, 'the node was deactivated')

    def release(self) -> None:
        """Let go of the network and the publishers."""
        if self._outputs is not None:
            self._outputs.destroy()
        self._outputs = self._exchange = None

    def live(self, name: str) -> bool:
        """Whether a parameter may change while the node is configured."""
        return name in LIVE or (name.startswith('registrar.') and name != 'registrar.weights')

    def changed(self, config: NodeConfig) -> None:
        """Use other settings from the next pair on."""
        self._exchange.registrar.config = config.registrar
        if self._pairing is not None:
            self._pairing.max_dt, self._pairing.on_demand = config.max_pair_dt, config.on_demand

    def _receive(self, side: Side, message: PointCloud2) -> None:
        self._health.heard(side, message.header.frame_id, time.monotonic())
        self._pairing.add(side, seconds(message.header.stamp), message)

    def _register(self, source: PointCloud2, target: PointCloud2) -> None:
        scans = {'source': self._exchange.read(source), 'target': self._exchange.read(target)}
        registered = self._exchange.register(**scans)
        result, worker = registered.result, self._worker
        if worker is None or worker.stopping:
            return
        stamps = seconds(source.header.stamp), seconds(target.header.stamp)
        if result.accepted:
            if self._tracking is not None:
                result = self._tracking.registered(
                    result, target.header.frame_id, source=stamps[0], target=stamps[1]
                )
            self._publish(replace(registered, result=result), source, target, scans['source'])
        age = self.get_clock().now().nanoseconds * 1e-9 - max(stamps)
        self._health.done(health.Outcome(result, age, stamps[0] - stamps[1]))
        text = describe(result)
        self._answer(result.accepted, text)
        self.get_logger().info(f'{text}, {result.ms["total"]:.0f} ms')

    def _publish(
        self, registered: Registered, source: PointCloud2, target: PointCloud2, scan: Scan
    ) -> None:
        wanted = self._outputs.wants_matches
        self._outputs.publish(
            registered.result,
            source=source,
            target=target,
            cloud=scan.cloud,
            matches=self._exchange.agreeing(registered) if wanted else None,
        )

    def _left_out(self, reason: str) -> None:
        self._health.failed(reason)
        self._answer(False, f'pair left out: {reason}')
        self.get_logger().error(f'pair left out: {reason}')

    async def _trigger(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Register the newest pair, registered before or not, and tell what came out."""
        future: Future = Future(executor=self.executor)
        self._asked.append(future)
        if self._pairing is None:
            self._answer(False, f'the node is {self.state}; activate it first')
        elif not self._pairing.ask():
            self._answer(False, 'no pair of clouds has come yet; see /diagnostics')
        response.success, response.message = await future
        return response

    def _answer(self, success: bool, message: str) -> None:
        """Answer everybody who has called `~/trigger`."""
        waiting, self._asked = self._asked, []
        for future in waiting:
            future.set_result((success, message))

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget pairs, stamps and counts."""
        if self._pairing is not None:
            self._pairing.reset()
        if self._tracking is not None:
            self._tracking.reset()
        self._health = health.Health(began=time.monotonic())
        response.success, response.message = True, 'pairs, stamps and counts forgotten'
        return response

    def _report(self) -> Report:
        """What the diagnostics say."""
        now, pairing, config = time.monotonic(), self._pairing, self.config
        if self.problem:
            return health.ERROR, f'{self.state}: {self.problem}', {'state': self.state}
        if pairing is None or config is None:
            return health.WARN, f'{self.state}, not active', {'state': self.state}
        limits = health.Limits(config.silence, config.max_age, config.max_pair_dt)
        level, message = self._health.judge(now, limits, pairing.offset())
        figures = self._health.figures(now, pairing.counts)
        if self._tracking is not None:
            figures |= self._tracking.figures()
        return level, message, {'state': self.state, **figures}


def subscribe(node: Node, side: Side, receive: Any, qos: QoSProfile) -> Any:
    """Subscribe to the clouds of one side."""
    return node.create_subscription(
        PointCloud2, f'{side}/points', lambda message: receive(side, message), qos
    )


def describe(result: Registration) -> str:
    """One line on an outcome."""
    if not result.accepted:
        return f'no transform: {result.reason}'
    return f'{result.inliers} inliers, probability {result.probability:.3f}'


def main() -> None:
    """Run the node until Ctrl-C or SIGTERM."""
    run(RegistrarNode)


if __name__ == '__main__':
    main()
