"""What is taken from the network: messages beyond these sizes are refused before they are kept.

Whoever reaches the DDS domain can publish on every topic. Each limit is well above what sensors
and `describer` send; docs/security.md tells what it bounds.
"""

from __future__ import annotations

from typing import Any

from gcl_core.errors import GclError
from gcl_ros.conversions import name_of
from gcl_ros.feature_cloud import is_feature_cloud

MAX_POINTS = 1_000_000  # of a raw cloud, by default: twice what a 128-beam sensor sends
MAX_POINT_BYTES = 128  # of each: drivers send 12 to 48
MAX_FIELDS, MAX_NAME = 64, 255  # fields of a cloud; characters of a frame's or field's name
MAX_HEADINGS, MAX_KEY_POINTS = 36, 20_000  # rows of a feature cloud, and key points in each
MAX_WAITING = 100  # callers of `~/trigger` at a time
MAX_POSES = 10_000  # of odometry that are kept: 30 s at 333 Hz


def check_limits(message: Any, max_points: int = MAX_POINTS) -> None:
    """Check a cloud as it comes in.

    Args:
        message: sensor_msgs/PointCloud2.
        max_points: of a raw cloud.

    Raises:
        GclError: something about it is larger than what is taken.
    """
    frame = message.header.frame_id
    if len(frame) > MAX_NAME:
        raise GclError(
            f'cloud in a frame whose name has {len(frame)} characters, {MAX_NAME} are taken; '
            'check who publishes it'
        )
    name = name_of(message)
    if len(message.fields) > MAX_FIELDS:
        raise GclError(
            f'{name} has {len(message.fields)} fields, {MAX_FIELDS} are taken; check its driver'
        )
    if any(len(field.name) > MAX_NAME for field in message.fields):
        raise GclError(
            f'{name} has a field whose name is over {MAX_NAME} characters; check its driver'
        )
    if is_feature_cloud(message):
        if message.height > MAX_HEADINGS or message.width > MAX_KEY_POINTS:
            raise GclError(
                f'feature {name} has {message.height} headings of {message.width} key points, '
                f'{MAX_HEADINGS} of {MAX_KEY_POINTS} are taken; lower turns or keypoints there'
            )
    elif message.width * message.height > max_points:
        raise GclError(
            f'{name} has {message.width * message.height} points, {max_points} are taken; thin it '
            'out, or raise max_points'
        )
    if len(message.data) > max_points * MAX_POINT_BYTES:
        raise GclError(
            f'{name} carries {len(message.data)} bytes, {max_points * MAX_POINT_BYTES} are taken; '
            'leave fields out, or raise max_points'
        )
