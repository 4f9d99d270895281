"""Which topics the node's inputs are, and who publishes on them: what `ros2 topic info` knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy

from gcl_core.errors import GclError


@dataclass(frozen=True)
class Publisher:
    """One that publishes on a topic.

    Attributes:
        node: its full name.
        kind: type of its messages.
        reliable: whether subscribers may ask for that.
    """

    node: str
    kind: str
    reliable: bool


@dataclass(frozen=True)
class Wires:
    """What is known of a topic.

    Attributes:
        topic: its full name, after remapping.
        publishers: all of them, on this machine and others.
    """

    topic: str
    publishers: tuple[Publisher, ...]

    @property
    def several(self) -> str:
        """What is wrong with so many publishers; empty with one or none."""
        if len(self.publishers) < 2:
            return ''
        return f'{len(self.publishers)} publishers on {self.topic} ({self._who}): one is enough'

    def silent(self, kind: str, reliable: bool) -> str:
        """Why nothing may come, as far as one can tell.

        Args:
            kind: type of the messages that are expected, such as `sensor_msgs/msg/PointCloud2`.
            reliable: whether the subscription is.
        """
        if not self.publishers:
            return f'nobody publishes on {self.topic}'
        first = self.publishers[0]
        others = next((p for p in self.publishers if p.kind != kind), None)
        if others is not None:
            return f'{others.node} publishes {others.kind} on {self.topic}, expected {kind}'
        if reliable and not first.reliable:
            return f'{first.node} publishes best effort on {self.topic}, but reliable is asked for'
        return f'{self._who} on {self.topic} sends nothing, or it is lost on the way'

    @property
    def _who(self) -> str:
        return ', '.join(sorted(publisher.node for publisher in self.publishers))


def wires(node: Node, topic: str) -> Wires:
    """Ask the graph about an input of a node.

    Args:
        node: whose input it is.
        topic: its name before remapping.
    """
    found = [
        Publisher(
            f'{info.node_namespace.rstrip("/")}/{info.node_name}',
            info.topic_type,
            info.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
        )
        for info in node.get_publishers_info_by_topic(topic)
    ]
    return Wires(node.resolve_topic_name(topic), tuple(found))


def check_distinct(node: Node, topics: Sequence[str]) -> None:
    """Refuse inputs that are one topic after remapping.

    Raises:
        GclError: two of them are; names them and it.
    """
    taken: dict[str, str] = {}
    for topic in topics:
        resolved = node.resolve_topic_name(topic)
        if resolved in taken:
            raise GclError(
                f'{taken[resolved]} and {topic} are both {resolved}: one vehicle would be taken '
                'for two; remap each to the topic of its own vehicle'
            )
        taken[resolved] = topic
