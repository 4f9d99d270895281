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
    """Read x, y, z of a `sensor_msgs/PointCloud2`, any layout and byte order, in metres.

    Points that are not finite are left out.

    Raises:
        GclError: no points, a field missing or not a float, sizes that do not add up, or no finite
            point.
    """
    points = every_point(message)
    with np.errstate(over='ignore', invalid='ignore'):
        all_finite = np.isfinite(points.sum())  # finite only if all of it is
    return PointCloud(points) if all_finite else kept(points, finite(points), message)


def every_point(message: Any) -> np.ndarray:
    """Read x, y, z of every point, finite or not: (n, 3) float32.

    Raises:
        GclError: as `point_cloud`.
    """
    name = name_of(message)
    check_size(message, name)
    fields = {field.name: field for field in message.fields}
    for axis in 'xyz':
        if axis not in fields:
            raise GclError(f'{name} has no field {axis!r}; it has {", ".join(fields) or "none"}')
        kind = _DATATYPES.get(fields[axis].datatype, '')
        if kind not in ('f4', 'f8'):
            raise GclError(
                f'{name}: field {axis!r} has datatype {fields[axis].datatype}, not a float'
            )
        if fields[axis].count > 1:
            raise GclError(f'{name}: field {axis!r} has {fields[axis].count} values a point')
    return _packed(message, fields, name)


def name_of(message: Any) -> str:
    """What errors call a cloud."""
    return f'cloud in frame {message.header.frame_id!r}'


def finite(points: np.ndarray) -> np.ndarray:
    """Which points are finite."""
    x, y, z = np.isfinite(points).T
    return x & y & z


def kept(points: np.ndarray, which: np.ndarray, message: Any) -> PointCloud:
    """Keep some of the points of a message.

    Raises:
        GclError: none is left.
    """
    points = np.compress(which, points, axis=0)
    if len(points) == 0:
        raise GclError(f'{name_of(message)}: none of its points is finite; check the sensor')
    return PointCloud(points)


def check_size(message: Any, name: str) -> None:
    """Check that the bytes of a PointCloud2 are as many as it claims.

    Raises:
        GclError: it is empty, or too short.
    """
    height, width, step = int(message.height), int(message.width), int(message.point_step)
    carried, count = len(message.data), width * height
    if count == 0 and carried:
        raise GclError(
            f'{name} is empty by its height {height} and width {width}, but carries {carried} '
            'bytes; its driver must set both: height 1, and width the number of points'
        )
    if count == 0:
        raise GclError(f'{name} is empty; check the driver')
    if row_bytes(message) is None:
        raise GclError(
            f'{name} claims {count} points of {step} bytes but carries {carried} bytes (height '
            f'{height}, width {width}, point_step {step}, row_step {message.row_step}); check the '
            'driver'
        )


def row_bytes(message: Any) -> int | None:
    """Bytes from one row of a PointCloud2 to the next; None if they do not fit its data.

    Several drivers and simulators fill row_step wrongly. It only counts where rows are longer than
    their points, and the data is as long as it says.
    """
    height, row_step = int(message.height), int(message.row_step)
    tight, carried = int(message.point_step) * int(message.width), len(message.data)
    if carried == tight * height or (height == 1 and carried >= tight):
        return tight
    return row_step if row_step >= tight and carried >= row_step * height else None


def column(message: Any, field: Any, name: str) -> np.ndarray:
    """View one field of a PointCloud2 of the right size: (height, width) or with its count.

    Raises:
        GclError: it lies outside the point, or has no known datatype.
    """
    kind = _DATATYPES.get(field.datatype)
    if kind is None:
        raise GclError(f'{name}: field {field.name!r} has the unknown datatype {field.datatype}')
    size, count, step = int(kind[1]), max(int(field.count), 1), int(message.point_step)
    if field.offset + size * count > step:
        raise GclError(f'{name}: field {field.name!r} lies outside the {step} bytes of a point')
    return np.ndarray(
        shape=(int(message.height), int(message.width), *([count] if count > 1 else [])),
        dtype=('>' if message.is_bigendian else '<') + kind,
        buffer=memoryview(message.data),
        offset=int(field.offset),
        strides=(row_bytes(message), step, *([size] if count > 1 else [])),
    )


def _packed(message: Any, fields: dict[str, Any], name: str) -> np.ndarray:
    """Copy x, y, z into one (n, 3) array of float32."""
    columns = [column(message, fields[axis], name) for axis in 'xyz']
    points = np.empty((columns[0].size, 3), dtype=np.float32)
    with np.errstate(over='ignore', invalid='ignore'):  # too large for float32: not finite
        for axis, values in enumerate(columns):
            points[:, axis] = values.reshape(-1)
    return points


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
    _fill(message.translation, message.rotation, T)
    return message


def matrix(message: Any) -> np.ndarray:
    """4x4 matrix of a `geometry_msgs/Transform`; a GclError if it is none."""
    return _rigid(message.rotation, message.translation)


def fill_pose(message: Any, T: np.ndarray) -> Any:
    """Fill a `geometry_msgs/Pose` from a 4x4 matrix; returns it."""
    _fill(message.position, message.orientation, T)
    return message


def pose_matrix(message: Any) -> np.ndarray:
    """4x4 matrix of a `geometry_msgs/Pose`; a GclError if it is none."""
    return _rigid(message.orientation, message.position)


def _fill(place: Any, turn: Any, T: np.ndarray) -> None:
    place.x, place.y, place.z = map(float, T[:3, 3])
    turn.x, turn.y, turn.z, turn.w = se3.to_quaternion(T[:3, :3])


def _rigid(q: Any, t: Any) -> np.ndarray:
    numbers = np.array([q.x, q.y, q.z, q.w, t.x, t.y, t.z])
    if not (np.isfinite(numbers).all() and 0.9 < np.linalg.norm(numbers[:4]) < 1.1):
        raise GclError(f'{numbers.tolist()} (x y z w, x y z) is no pose; check who sends it')
    return se3.from_rotation_translation(se3.from_quaternion(*numbers[:4]), numbers[4:])


def seconds(stamp: Any) -> float:
    """Seconds of a `builtin_interfaces/Time`."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
