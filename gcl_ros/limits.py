"""What is taken from the network: messages beyond these sizes are refused before they are kept.

Whoever reaches the DDS domain can publish on every topic. Each limit is well above what sensors
and `sender` send; docs/security.md tells what it bounds.
"""

from __future__ import annotations

from typing import Any

from gcl_core.errors import GclError
from gcl_ros.compact_cloud import compact_header, is_compact
from gcl_ros.conversions import name_of

MAX_POINTS = 1_000_000  # of a cloud, by default: twice what a 128-beam sensor sends
MAX_POINT_BYTES = 128  # of each: drivers send 12 to 48
MAX_FIELDS, MAX_NAME = 64, 255  # fields of a cloud; characters of a frame's or field's name
MAX_WAITING = 100  # callers of `~/trigger` at a time
MAX_POSES = 10_000  # of odometry that are kept: 30 s at 333 Hz


def check_limits(message: Any, max_points: int = MAX_POINTS) -> None:
    """Check a cloud as it comes in.

    Args:
        message: sensor_msgs/PointCloud2.
        max_points: of a raw cloud; voxels of a compact scan.

    Raises:
        GclError: something about it is larger than what is taken, or of another version.
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
    compact = is_compact(message)
    count = compact_header(message).count if compact else message.width * message.height
    if count > max_points:
        raise GclError(
            f'{name} has {count} {"voxels" if compact else "points"}, {max_points} are taken; '
            f'{"choose larger voxels there" if compact else "thin it out"}, or raise max_points'
        )
    if len(message.data) > max_points * MAX_POINT_BYTES:
        raise GclError(
            f'{name} carries {len(message.data)} bytes, {max_points * MAX_POINT_BYTES} are taken; '
            'leave fields out, or raise max_points'
        )
