"""Between ROS messages and the types of gcl_core. Works on rclpy's and on rosbags' messages."""

from __future__ import annotations

import array
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

# sensor_msgs/PointField datatypes
_DATATYPES = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
_FLOAT32 = 7


def point_cloud(message: Any) -> PointCloud:
    """Read x, y, z of a `sensor_msgs/PointCloud2`, any layout and byte order.

    Raises:
        GclError: no points, a field missing or not a float, sizes that do not add up, or no finite
            point.
    """
    count = int(message.width) * int(message.height)
    name = f'cloud in frame {message.header.frame_id!r}'
    if count == 0:
        raise GclError(f'{name} is empty; check the driver')
    step, row_step = int(message.point_step), int(message.row_step)
    if row_step < step * int(message.width) or len(message.data) < row_step * int(message.height):
        raise GclError(
            f'{name} claims {count} points of {step} bytes but carries {len(message.data)} bytes'
        )
    order = '>' if message.is_bigendian else '<'
    fields = {field.name: field for field in message.fields}
    formats, offsets = [], []
    for axis in ('x', 'y', 'z'):
        field = fields.get(axis)
        if field is None:
            raise GclError(f'{name} has no field {axis!r}; it has {", ".join(fields) or "none"}')
        kind = _DATATYPES.get(field.datatype, '')
        if kind not in ('f4', 'f8'):
            raise GclError(f'{name}: field {axis!r} has datatype {field.datatype}, not a float')
        if field.offset + int(kind[1]) > step:
            raise GclError(f'{name}: field {axis!r} lies outside the {step} bytes of a point')
        formats.append(order + kind)
        offsets.append(field.offset)
    layout = np.dtype(
        {'names': ['x', 'y', 'z'], 'formats': formats, 'offsets': offsets, 'itemsize': step}
    )
    data = np.frombuffer(memoryview(message.data), dtype=np.uint8)
    rows = data[: row_step * int(message.height)].reshape(int(message.height), row_step)
    packed = np.ascontiguousarray(rows[:, : step * int(message.width)])
    points = packed.reshape(-1).view(layout)
    xyz = np.stack([points['x'], points['y'], points['z']], axis=1)
    return PointCloud.from_array(xyz, name)


def fill_point_cloud2(message: Any, points: np.ndarray, field_type: Any) -> Any:
    """Fill an empty PointCloud2 with (n, 3) points as packed float32; returns it."""
    message.height, message.width = 1, len(points)
    message.fields = [
        field_type(name=axis, offset=4 * i, datatype=_FLOAT32, count=1)
        for i, axis in enumerate('xyz')
    ]
    message.is_bigendian, message.is_dense = False, True
    message.point_step, message.row_step = 12, 12 * len(points)
    data = array.array('B')
    data.frombytes(np.ascontiguousarray(points, dtype='<f4').tobytes())
    message.data = data
    return message


def fill_transform(message: Any, T: np.ndarray) -> Any:
    """Fill a `geometry_msgs/Transform` from a 4x4 matrix; returns it."""
    message.translation.x, message.translation.y, message.translation.z = map(float, T[:3, 3])
    rotation = message.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = se3.to_quaternion(T[:3, :3])
    return message


def matrix(message: Any) -> np.ndarray:
    """4x4 matrix of a `geometry_msgs/Transform`."""
    q, t = message.rotation, message.translation
    return se3.from_rotation_translation(
        se3.from_quaternion(q.x, q.y, q.z, q.w), np.array([t.x, t.y, t.z])
    )


def seconds(stamp: Any) -> float:
    """Seconds of a `builtin_interfaces/Time`."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
