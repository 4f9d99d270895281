"""Messages from strangers: taken as bytes and parsed in Python, not by the middleware.

Fast CDR 2.3, which parses for rclpy, reads past a payload that ends with its header, which mostly
ends the process; anybody on the network can send four such bytes. Bags are parsed by the same
function.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from gcl_core.errors import GclError
from gcl_ros.bag_reader import deserialized, message_types


def subscribe(
    node: Node,
    kind: type,
    topic: str,
    receive: Callable[[Any], None],
    refuse: Callable[[str], None],
    qos: QoSProfile,
) -> Subscription:
    """Subscribe to a topic that anybody may publish on.

    Args:
        node: that subscribes.
        kind: rclpy's type of the messages.
        topic: its name.
        receive: gets each message as rosbags has it: the same fields, arrays of numpy.
        refuse: gets the reason for each message that is none.
        qos: of the subscription.
    """
    message_types()  # tenths of a second, not at the first cloud
    package, folder, _ = kind.__module__.split('.')
    name = f'{package}/{folder}/{kind.__name__}'

    def take(raw: bytes) -> None:
        try:
            message = deserialized(raw, name)
        except GclError as error:
            refuse(str(error))
        else:
            receive(message)

    return node.create_subscription(kind, topic, take, qos, raw=True)


def header_of(message: Any) -> Header:
    """The header of such a message, to publish with."""
    header = Header(frame_id=message.header.frame_id)
    header.stamp.sec = int(message.header.stamp.sec)
    header.stamp.nanosec = int(message.header.stamp.nanosec)
    return header
