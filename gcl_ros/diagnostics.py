"""`/diagnostics` once a second, in standard messages that any aggregator or monitor reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.node import Node

PERIOD = 1.0  # seconds
Report = tuple[int, str, Mapping[str, str]]  # level, message, figures


class Diagnostics:
    """Publishes what `report` says, in every state of the node.

    Args:
        node: to publish from.
        report: called for each message.
        clock: that does not stop when simulated time does.
    """

    def __init__(self, node: Node, report: Callable[[], Report], clock: Clock) -> None:
        self._node, self._report = node, report
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        node.create_timer(PERIOD, self.publish, clock=clock)

    def publish(self) -> None:
        """Publish now."""
        level, message, figures = self._report()
        status = DiagnosticStatus(
            level=bytes([level]),
            name=self._node.get_fully_qualified_name().lstrip('/'),
            message=message,
            values=[KeyValue(key=key, value=value) for key, value in figures.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
