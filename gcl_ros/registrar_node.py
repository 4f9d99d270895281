"""`ros2 run gcl_ros registrar`: two PointCloud2 topics in, their relative transform out.

Subscribes: `source/points`, `target/points` (sensor_msgs/PointCloud2), raw or from `sender`;
    more sources by the parameter `sources`.
Publishes: `~/transform` (geometry_msgs/TransformStamped), `~/pose`
    (geometry_msgs/PoseWithCovarianceStamped), both with frame = the target's, child = the
    source's, stamp = the later of the pair's; nothing when nothing is accepted. `/diagnostics`.
    If asked for, `/tf`, `~/aligned` (sensor_msgs/PointCloud2) and `~/matches`
    (visualization_msgs/Marker); with odometry `~/track`, see `gcl_ros.tracking`.
Serves: `~/trigger` (std_srvs/Trigger) registers the newest pair, `~/reset` forgets all.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from gcl_core.errors import GclError
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import Registration
from gcl_ros import health, limits, transport
from gcl_ros.answers import Answers
from gcl_ros.conversions import seconds
from gcl_ros.diagnostics import Diagnostics, Report
from gcl_ros.exchange import Exchange
from gcl_ros.lifecycle import ConfiguredNode
from gcl_ros.link import SINGLE, Link
from gcl_ros.outputs import Wanted
from gcl_ros.pairings import Pairings
from gcl_ros.streams import Limits
from gcl_ros.tracking import MotionConfig
from gcl_ros.wire import subscribe
from gcl_ros.wiring import check_distinct
from gcl_ros.worker import Worker

# Name of the source, its cloud, the target's; one of them is None while it is still awaited.
Work = tuple[str, PointCloud2 | None, PointCloud2 | None]


@dataclass(frozen=True)
class NodeConfig:
    """Parameters of the node.

    Attributes:
        autostart: configure and activate at start; otherwise wait for lifecycle transitions.
        sources: vehicles to register to the target, each with its topic NAME/points. One called
            `source` publishes on `~/`, others on `~/NAME/`.
        max_pair_dt: clouds whose stamps differ by more than this are no pair, seconds.
        reliable: reliable subscriptions; they do not match best-effort publishers.
        on_demand: register a pair only when `~/trigger` is called.
        silence: a topic without a cloud for this long is a warning in the diagnostics, seconds.
        max_age: a transform this long after its stamp is a warning in the diagnostics, seconds.
        max_points: clouds of more points, or compact scans of more voxels, are refused; it bounds
            memory and time.
        publish_tf: broadcast the transform on /tf too. The source's frame must have no other
            parent; needs tf2_ros.
        publish_aligned: publish the source cloud in the target's frame on `~/aligned`.
        publish_matches: publish the correspondences that agree as lines on `~/matches`.
        motion: what the vehicles' odometry is used for.
        registrar: what happens between two clouds and a transform.
    """

    autostart: bool = True
    sources: tuple[str, ...] = (SINGLE,)
    max_pair_dt: float = 0.1
    reliable: bool = False
    on_demand: bool = False
    silence: float = 2.0
    max_age: float = 5.0
    max_points: int = limits.MAX_POINTS
    publish_tf: bool = False
    publish_aligned: bool = False
    publish_matches: bool = False
    motion: MotionConfig = field(default_factory=MotionConfig)
    registrar: RegistrarConfig = field(default_factory=RegistrarConfig)

    def __post_init__(self) -> None:
        names = self.sources
        if not names or len(set(names)) < len(names) or 'target' in names:
            raise GclError(f'sources is {list(names)}; name each once, and none of them target')
        for name in names:
            if not re.fullmatch(r'[A-Za-z]\w*(/[A-Za-z]\w*)*', name):
                raise GclError(f'sources has {name!r}, which is no name of a topic')
        if len(names) > 1 and self.motion.source_mount != MotionConfig().source_mount:
            raise GclError(
                'motion.source_mount is for one source; mount all alike, or run more nodes'
            )


# Parameters that may change at any time, and the registrar's but the network's.
LIVE = ('max_pair_dt', 'on_demand', 'silence', 'max_age', 'max_points')
NETWORK = ('registrar.weights', 'registrar.device', 'registrar.precision')


class RegistrarNode(ConfiguredNode[NodeConfig]):
    """Callbacks take the newest clouds; one worker thread registers them, source after source."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('registrar', NodeConfig, **kwargs)
        self._exchange: Exchange | None = None
        self._links: dict[str, Link] = {}
        self._pairings: Pairings[PointCloud2] | None = None
        self._worker: Worker[Work] | None = None
        self._inputs: list[Any] = []
        self._answers = Answers()
        self._callers = 0  # who had called for a pair when the one at work was taken
        self._at_work = threading.Lock()  # held for a pair, which may outlive its activation
        alone = ReentrantCallbackGroup()  # a caller that waits holds up nothing else
        self.create_service(Trigger, '~/trigger', self._trigger, callback_group=alone)
        self.create_service(Trigger, '~/reset', self._reset)
        self._diagnostics = Diagnostics(self, self._report, self.steady)

    def build(self, config: NodeConfig) -> None:
        """Load the network and create the publishers.

        Raises:
            GclError: two inputs are one topic, or the network cannot be loaded.
        """
        for kind in ('points', 'odometry') if config.motion.odometry else ('points',):
            check_distinct(self, [f'{name}/{kind}' for name in (*config.sources, 'target')])
        self._exchange = Exchange(Registrar(config.registrar))
        wanted = Wanted(config.publish_tf, config.publish_aligned, config.publish_matches)
        for name in config.sources:
            self._links[name] = Link(self, name, wanted)
        rmw = rclpy.get_rmw_implementation_identifier()
        if lost := transport.warning(rmw, reliable=config.reliable, read=transport.read_here()):
            self.get_logger().warning(lost)

    def begin(self) -> None:
        """Subscribe and start the worker."""
        config = self.config
        names = config.sources
        self._pairings = Pairings(names, config.max_pair_dt, on_demand=config.on_demand)
        for name, link in self._links.items():
            link.begin(self._pairings.of[name], config.motion)
        self._worker = Worker(
            self._pairings.take, self._register, self._left_out, self._pairings.close
        )
        policy = ReliabilityPolicy.RELIABLE if config.reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=1, reliability=policy)  # deeper, and clouds grow seconds old
        receivers = {name: partial(self._receive_source, name) for name in names}
        self._inputs = [
            subscribe(
                self, PointCloud2, f'{name}/points', receive, partial(self._refuse, name), qos
            )
            for name, receive in {**receivers, 'target': self._receive_target}.items()
        ]
        engine = self._exchange.registrar.engine
        self.get_logger().info(f'ready; weights {config.registrar.weights}, {engine}')
        if why := self._exchange.registrar.uncalibrated:
            self.get_logger().warning(why)

    def end(self) -> None:
        """Unsubscribe and let the worker finish its pair, which is not published any more."""
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        self._inputs = []
        if self._worker is not None:
            self._worker.stop()
            self._worker = self._pairings = None
        for link in self._links.values():
            link.end()
        self._answers.give_up('the node was deactivated')

    def release(self) -> None:
        """Let go of the network and the publishers."""
        for link in self._links.values():
            link.destroy()
        if self._exchange is not None:
            self._exchange.close()
        self._links, self._exchange = {}, None

    def live(self, name: str) -> bool:
        """Whether a parameter may change while the node is configured."""
        return name in LIVE or (name.startswith('registrar.') and name not in NETWORK)

    def changed(self, config: NodeConfig) -> None:
        """Use other settings from the next pair on."""
        for pairing in self._pairings.of.values() if self._pairings else ():
            pairing.max_dt, pairing.on_demand = config.max_pair_dt, config.on_demand

    def _takes(self, name: str, message: PointCloud2) -> bool:
        """Whether a cloud of a vehicle is within the limits."""
        try:
            limits.check_limits(message, self.config.max_points)
        except GclError as error:
            self._refuse(name, str(error))
            return False
        return True

    def _refuse(self, name: str, reason: str) -> None:
        """Tell in the log and the diagnostics why a cloud of a vehicle is left out."""
        for link in self._links.values() if name == 'target' else [self._links[name]]:
            link.health.failed(reason)
        self.get_logger().error(f'cloud left out: {reason}', throttle_duration_sec=5.0)

    def _receive_source(self, name: str, message: PointCloud2) -> None:
        if not self._takes(name, message):
            return
        self._links[name].heard('source', message)
        self._pairings.of[name].add('source', seconds(message.header.stamp), message)

    def _receive_target(self, message: PointCloud2) -> None:
        if not self._takes('target', message):
            return
        for link in self._links.values():
            link.heard('target', message)
        self._pairings.add_target(seconds(message.header.stamp), message)

    def _register(self, work: Work, wanted: Callable[[], bool]) -> None:
        with self._at_work:
            if wanted():
                self._exchange.registrar.config = self.config.registrar  # for all of this pair
                self._work_on(work, wanted)

    def _work_on(self, work: Work, wanted: Callable[[], bool]) -> None:
        name, source, target = work
        self._callers = self._answers.calls
        link, exchange = self._links[name], self._exchange
        if source is None or target is None:
            link.prepare(exchange, target if source is None else source)
            return
        result = link.register(exchange, source, target, wanted=wanted)
        if result is not None:
            told = describe(result)
            self._answers.outcome(name, result.accepted, told, calls=self._callers)
            self.get_logger().info(f'{name}: {told}, {result.ms["total"]:.0f} ms')

    def _left_out(self, work: Work, reason: str) -> None:
        name = work[0]
        if self._pairings.of[name].forgotten:
            return
        self._links[name].health.failed(reason)
        self._answers.outcome(name, False, f'pair left out: {reason}', calls=self._callers)
        self.get_logger().error(f'{name}: pair left out: {reason}')

    async def _trigger(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Register the newest pairs, registered before or not, and tell what comes out."""
        if self._pairings is None:
            response.message = f'the node is {self.state}; activate it first'
            return response
        have = [name for name, pairing in self._pairings.of.items() if pairing.has_pair]
        if not have:
            response.message = 'no pair of clouds has come yet; see /diagnostics'
            return response
        if self._answers.waiting >= limits.MAX_WAITING:
            response.message = f'{limits.MAX_WAITING} callers wait already; call again later'
            return response
        future = self._answers.expect(have, self.executor)
        for name in have:
            self._pairings.of[name].ask()
        response.success, response.message = await future
        return response

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget pairs, stamps and counts."""
        for link in self._links.values():
            link.reset()
        self._answers.give_up('reset: pairs were forgotten')
        response.success, response.message = True, 'pairs, stamps and counts forgotten'
        return response

    def _report(self) -> list[Report]:
        """What the diagnostics say."""
        config, state = self.config, {'state': self.state}
        if self.problem:
            return [Report(health.ERROR, f'{self.state}: {self.problem}', state)]
        if self._pairings is None or config is None:
            return [Report(health.WARN, f'{self.state}, not active', state)]
        bounds = Limits(config.silence, config.max_age, config.max_pair_dt, config.reliable)
        return [link.report(bounds, self.state) for link in self._links.values()]


def describe(result: Registration) -> str:
    """One line on an outcome."""
    if not result.accepted:
        return f'no transform: {result.reason}'
    mark = '' if result.calibrated else ' (uncalibrated)'
    return f'{result.inliers} inliers, probability {result.probability:.3f}{mark}'
