"""`/diagnostics` once a second, in standard messages that any aggregator or monitor reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.node import Node

PERIOD = 1.0  # seconds


@dataclass(frozen=True)
class Report:
    """What is said about one thing.

    Attributes:
        level: of `health`.
        message: one line.
        figures: by their keys.
        about: what it is about, where a node says several things.
    """

    level: int
    message: str
    figures: Mapping[str, str]
    about: str = ''


class Diagnostics:
    """Publishes what `report` says, in every state of the node.

    Args:
        node: to publish from.
        report: called for each message.
        clock: that does not stop when simulated time does.
    """

    def __init__(self, node: Node, report: Callable[[], Sequence[Report]], clock: Clock) -> None:
        self._node, self._report = node, report
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        node.create_timer(PERIOD, self.publish, clock=clock)

    def publish(self) -> None:
        """Publish now."""
        name = self._node.get_fully_qualified_name().lstrip('/')
        array = DiagnosticArray()
        array.status = [
            DiagnosticStatus(
                level=bytes([report.level]),
                name=f'{name}: {report.about}' if report.about else name,
                message=report.message,
                values=[KeyValue(key=key, value=value) for key, value in report.figures.items()],
            )
            for report in self._report()
        ]
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
