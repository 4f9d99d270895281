"""Rigid motions as 4x4 matrices, float64, `T_target_source`: source points into target.

Inner indices cancel: `T_a_c = T_a_b @ T_b_c`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def from_rotation_translation(
    rotation: Float[np.ndarray, '3 3'], translation: Float[np.ndarray, '3']
) -> Float[np.ndarray, '4 4']:
    """Assemble a 4x4 transform."""
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = translation
    return T


def rotation_z(yaw: float) -> Float[np.ndarray, '3 3']:
    """Rotate about +z by `yaw` radians, counter-clockwise seen from above."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def from_xyz_rpy(
    x: float = 0.0,
    y: float = 0.0,
    z: float = 0.0,
    roll: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
) -> Float[np.ndarray, '4 4']:
    """Build a transform from metres and radians, `Rz(yaw) Ry(pitch) Rx(roll)` (REP-103)."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    rotation_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    rotation_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    rotation = rotation_z(yaw) @ rotation_y @ rotation_x
    return from_rotation_translation(rotation, np.array([x, y, z]))


def inverse(T: Float[np.ndarray, '4 4']) -> Float[np.ndarray, '4 4']:
    """Invert a rigid transform."""
    rotation = T[:3, :3].T
    return from_rotation_translation(rotation, -rotation @ T[:3, 3])


def transform(
    T: Float[np.ndarray, '4 4'], points: Float[np.ndarray, 'n 3']
) -> Float[np.ndarray, 'n 3']:
    """Apply `T` to points; the result keeps their dtype."""
    # Not by a matrix product: its bits would depend on the number of threads, and OpenBLAS's spin
    # when they are done, which takes the cores from what comes next.
    x, y, z = np.ascontiguousarray(points.T)
    moved = np.empty_like(points)
    for axis, (a, b, c, d) in enumerate(T[:3].astype(points.dtype)):
        moved[:, axis] = x * a + y * b + z * c + d
    return moved


def rotation_angle(T: Float[np.ndarray, '4 4']) -> float:
    """Return the geodesic angle of the rotation part, in radians within [0, pi]."""
    # atan2 of the skew part stays exact near 0, where arccos of the trace does not.
    skew = T[:3, :3] - T[:3, :3].T
    sine = 0.5 * float(np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]]))
    cosine = 0.5 * (float(np.trace(T[:3, :3])) - 1.0)
    return float(np.arctan2(sine, cosine))


def yaw(T: Float[np.ndarray, '4 4']) -> float:
    """Return the heading of the rotation part, in radians within (-pi, pi]."""
    return float(np.arctan2(T[1, 0], T[0, 0]))


def to_quaternion(rotation: Float[np.ndarray, '3 3']) -> tuple[float, float, float, float]:
    """Return (x, y, z, w), the order of `geometry_msgs/Quaternion`."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return float(x), float(y), float(z), float(w)


def from_quaternion(x: float, y: float, z: float, w: float) -> Float[np.ndarray, '3 3']:
    """Return the rotation of a `geometry_msgs/Quaternion`."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix())
