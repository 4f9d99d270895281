"""A compact scan as a PointCloud2, which every ROS distribution has without building a package.

One field, `gcl_compact_scan`, of UINT8; as many points as the scan has bytes, in one row. Its
version and everything else is in the bytes, see `gcl_core.compact.scan`.
"""

from __future__ import annotations

import re
from typing import Any

from gcl_core.compact.scan import MOST_VOXELS, SIZE, Header, decode, read_header
from gcl_core.errors import GclError
from gcl_core.types import PointCloud
from gcl_ros.conversions import check_size, name_of

FIELD = 'gcl_compact_scan'
UINT8 = 2  # sensor_msgs/PointField datatype
_FEATURES = re.compile(r'gcl(\d+)_(\w+)')  # what `describer` sent before there were compact scans


def is_compact(message: Any) -> bool:
    """Whether a PointCloud2 carries a compact scan, or what was sent before there were any."""
    return any(field.name == FIELD or _FEATURES.fullmatch(field.name) for field in message.fields)


def fill_compact(message: Any, data: bytes, field_type: Any) -> Any:
    """Fill an empty PointCloud2 with a compact scan; returns it.

    Args:
        message: sensor_msgs/PointCloud2.
        data: of the scan.
        field_type: sensor_msgs/PointField.
    """
    message.height, message.width = 1, len(data)
    message.fields = [field_type(name=FIELD, offset=0, datatype=UINT8, count=1)]
    message.is_bigendian, message.is_dense = False, True
    message.point_step, message.row_step = 1, len(data)
    message.data = data
    return message


def compact_header(message: Any) -> Header:
    """Read the header of a compact scan alone, which costs next to nothing.

    Args:
        message: sensor_msgs/PointCloud2 of which `is_compact` holds.

    Raises:
        GclError: no compact scan, or of another version of gcl_ros.
    """
    name = name_of(message)
    if any(_FEATURES.fullmatch(field.name) for field in message.fields):
        raise GclError(
            f'{name} holds features, as `describer` of an older gcl_ros sent them; this version '
            'does not read them: install it on both vehicles and run `sender` there'
        )
    check_size(message, name)
    return read_header(bytes(message.data[:SIZE]), name)


def compact_cloud(message: Any, most_voxels: int = MOST_VOXELS) -> PointCloud:
    """Read a compact scan.

    Args:
        message: sensor_msgs/PointCloud2 of which `is_compact` holds.
        most_voxels: largest scan that is read.

    Raises:
        GclError: damaged, too large, or of another version of gcl_ros.
    """
    compact_header(message)
    return decode(bytes(message.data), name_of(message), most_voxels)
