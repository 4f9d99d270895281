"""One source against the target: its pairs, what it publishes, what it knows about itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from gcl_core.errors import GclError
from gcl_core.types import PointCloud, Registration
from gcl_ros import health
from gcl_ros.conversions import seconds
from gcl_ros.deskew import Swept
from gcl_ros.diagnostics import Report
from gcl_ros.exchange import Exchange, Registered
from gcl_ros.outputs import Outputs, Wanted
from gcl_ros.pairing import SIDES, Pairing, Side
from gcl_ros.streams import Limits
from gcl_ros.tracking import MotionConfig, Tracking
from gcl_ros.wiring import wires

SINGLE = 'source'  # name of the only source; its topics have no prefix
HEAD = 1000  # bytes of a cloud that tell two sweeps apart without reading all


class Link:
    """What the registrar holds for one source, from configure to cleanup.

    Args:
        node: to subscribe and publish from.
        name: of the source; prefix of its topics.
        wanted: what to publish.
    """

    def __init__(self, node: Node, name: str, wanted: Wanted) -> None:
        self._node, self.name = node, name
        self.prefix = '~/' if name == SINGLE else f'~/{name}/'
        self._outputs = Outputs(node, self.prefix, wanted)
        self.pairing: Pairing[PointCloud2] | None = None
        self._tracking: Tracking | None = None
        self.health = health.Health(name)
        self._last: dict[Side, PointCloud2] = {}
        self._swept: dict[Side, Swept] = {}  # of the pair at work, or of the last
        self._telling = threading.Lock()  # held while an outcome is published, or all is forgotten

    def begin(self, pairing: Pairing[PointCloud2], motion: MotionConfig) -> None:
        """Start listening."""
        self.pairing = pairing
        self.health = health.Health(self.name, began=time.monotonic())
        if motion.odometry:
            self._tracking = Tracking(self._node, motion, source=self.name, prefix=self.prefix)

    def end(self) -> None:
        """Stop listening."""
        self.pairing, self._last, self._swept = None, {}, {}
        if self._tracking is not None:
            self._tracking.destroy()
            self._tracking = None

    def destroy(self) -> None:
        """Destroy the publishers."""
        self._outputs.destroy()

    def reset(self) -> None:
        """Forget pairs, stamps, counts and the track."""
        with self._telling:
            if self.pairing is not None:
                self.pairing.reset()
            if self._tracking is not None:
                self._tracking.reset()
            self.health = health.Health(self.name, began=time.monotonic())

    def heard(self, side: Side, message: PointCloud2) -> None:
        """Note a cloud."""
        last, self._last[side] = self._last.get(side), message
        again = last is not None and repeated(last, message)
        self.health.heard(
            side,
            message.header.frame_id,
            seconds(message.header.stamp),
            now=time.monotonic(),
            clock=self._clock(),
            again=again,
        )

    def register(
        self,
        exchange: Exchange,
        source: PointCloud2,
        target: PointCloud2,
        wanted: Callable[[], bool],
    ) -> Registration | None:
        """Register a pair and publish what is accepted.

        Args:
            exchange: reads and registers.
            source: message.
            target: message.
            wanted: whether results still are; None comes back if not, or after `reset`.
        """
        pairing = self.pairing
        if same(source, target):
            raise GclError(
                f'source and target are one cloud, in frame {source.header.frame_id!r}: a vehicle '
                'would be registered to itself; check what is published on the two topics'
            )
        scans = {
            'source': exchange.read(source, deskew=partial(self._deskewed, 'source')),
            'target': exchange.read(target, deskew=partial(self._deskewed, 'target')),
        }
        self._swept = {side: scan.swept for side, scan in scans.items()}
        if self._tracking is not None:
            self._tracking.swept = self._swept
        registered = exchange.register(**scans)
        with self._telling:
            if not wanted() or pairing.forgotten:
                return None
            self._tell(exchange, registered, scans['source'].cloud, source, target)
        return registered.result

    def _tell(
        self,
        exchange: Exchange,
        registered: Registered,
        cloud: PointCloud,
        source: PointCloud2,
        target: PointCloud2,
    ) -> None:
        """Publish a registration if it is accepted, and remember what came out."""
        result, outputs = registered.result, self._outputs
        stamps = {'source': seconds(source.header.stamp), 'target': seconds(target.header.stamp)}
        if result.accepted:
            together = result
            if self._tracking is not None:
                together = self._tracking.registered(result, target.header.frame_id, **stamps)
            outputs.publish(together, source=source, target=target)
            matches = exchange.agreeing(registered) if outputs.wants_matches else None
            outputs.show(result, target=target, cloud=cloud, matches=matches)
        age = self._clock() - max(stamps.values())
        dt = stamps['source'] - stamps['target']
        self.health.done(health.Outcome(result, age, dt))

    def prepare(self, exchange: Exchange, message: PointCloud2) -> None:
        """Describe a cloud whose partner is about to come; what is wrong with it is told then.

        With odometry it is left to the partner: the poses to undo its motion may not be here yet.
        """
        if self._tracking is not None:
            return
        with suppress(GclError):
            exchange.prepare(exchange.read(message))

    def _clock(self) -> float:
        return float(self._node.get_clock().now().nanoseconds) * 1e-9

    def _deskewed(self, side: Side, message: PointCloud2) -> Swept:
        return Swept() if self._tracking is None else self._tracking.deskewed(side, message)

    def report(self, limits: Limits, state: str) -> Report:
        """For the diagnostics, while active."""
        now, about = time.monotonic(), '' if self.name == SINGLE else self.name
        topics = {side: stream.topic for side, stream in self.health.streams.items()}
        level, message = self.health.judge(
            now,
            limits,
            self.pairing.offset(limits.silence),
            wires={side: wires(self._node, topic) for side, topic in topics.items()},
            others=self._tracking.warnings(now, limits) if self._tracking else (),
        )
        figures = {'state': state, **self.health.figures(now, self.pairing.counts)}
        figures['clouds waiting'] = str(self.pairing.waiting)
        if self._tracking is not None:
            figures |= self._tracking.figures()
        else:
            for side in SIDES:
                swept = self._swept.get(side, Swept())
                told = swept.told() if swept.by_sender else 'no: motion.odometry is off'
                figures[f'{side} de-skewed'] = told
        return Report(level, message, figures, about)


def repeated(last: PointCloud2, message: PointCloud2) -> bool:
    """Whether a cloud has the bytes of the one before, and another stamp."""
    return seconds(last.header.stamp) != seconds(message.header.stamp) and same(last, message)


def same(a: PointCloud2, b: PointCloud2) -> bool:
    """Whether two clouds have the same bytes."""
    return np.array_equal(a.data[:HEAD], b.data[:HEAD]) and np.array_equal(a.data, b.data)
