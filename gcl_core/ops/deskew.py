"""Points of a sweep that were seen one after the other, brought to one time.

Between two poses the sensor moves along a screw: straight on or in an arc, at an even rate. That
is what a vehicle drives, and whichever frame of it the poses are of, the motion is the same.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core import se3


def between(
    first: Float[np.ndarray, '4 4'], last: Float[np.ndarray, '4 4'], share: float
) -> Float[np.ndarray, '4 4']:
    """Pose at a share of the screw that leads from one pose to another; 0 is the first."""
    one = np.array([share])
    origin = _along(np.zeros((1, 3)), one, first, last)[0]
    axes = [_along(axis[None], one, first, last)[0] - origin for axis in np.eye(3)]
    return se3.from_rotation_translation(np.stack(axes, axis=1), origin)


def deskewed(
    points: Float[np.ndarray, 'n 3'],
    times: Float[np.ndarray, ' n'],
    *,
    stamps: Float[np.ndarray, ' m'],
    T_ref_lidar: Float[np.ndarray, 'm 4 4'],
) -> Float[np.ndarray, 'n 3']:
    """Bring every point from the sensor's frame at its own time into one frame.

    Args:
        points: metres, each as the sensor saw it.
        times: of the points, seconds; a point whose time is NaN stays as it is.
        stamps: of the poses, seconds, rising, at least two.
        T_ref_lidar: poses of the sensor in the frame wanted. Beyond the first and the last the
            motion between the outer two goes on.

    Returns:
        The points in the frame wanted; their dtype is kept.
    """
    moved = points.copy()
    known = np.flatnonzero(np.isfinite(times))
    step = np.clip(np.searchsorted(stamps, times[known], side='right') - 1, 0, len(stamps) - 2)
    order = np.argsort(step.astype(np.int32), kind='stable')
    ends = np.searchsorted(step[order], np.arange(len(stamps)))
    for k in np.unique(step):
        these = known[order[ends[k] : ends[k + 1]]]
        share = (times[these] - stamps[k]) / (stamps[k + 1] - stamps[k])
        moved[these] = _along(points[these], share, T_ref_lidar[k], T_ref_lidar[k + 1])
    return moved


def _along(
    points: Float[np.ndarray, 'n 3'],
    share: Float[np.ndarray, ' n'],
    first: Float[np.ndarray, '4 4'],
    last: Float[np.ndarray, '4 4'],
) -> Float[np.ndarray, 'n 3']:
    """Transform each point by the pose at its share of the screw between two poses.

    With the turn w about the unit axis a, of the angle |w|, at the share s:
    R(s) = I + sin(s|w|) [a] + (1 - cos(s|w|)) [a]^2, and t(s) is the integral of R(s) u over s,
    where u is such that t(1) is the translation.
    """
    from scipy.spatial.transform import Rotation

    motion = se3.inverse(first) @ last
    bend = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    angle = max(float(np.linalg.norm(bend)), 1e-12)  # in the limit straight on
    axis = np.cross(bend / angle, np.eye(3)).T  # [a]
    twice = axis @ axis
    reach = np.eye(3) + (1 - np.cos(angle)) / angle * axis + (1 - np.sin(angle) / angle) * twice
    pull = np.linalg.solve(reach, motion[:3, 3])
    x = np.ascontiguousarray(points.T, dtype=np.float64)  # (3, n): long rows are quick
    sine, rest = np.sin(share * angle), 1 - np.cos(share * angle)
    across = np.einsum('ij,jn->in', axis, x)  # no product of BLAS: its threads spin afterwards
    moved = x + sine * across + rest * np.einsum('ij,jn->in', axis, across)
    for offset, factor in (
        (pull + twice @ pull, share),
        (-twice @ pull / angle, sine),
        (axis @ pull / angle, rest),
    ):
        moved += offset[:, None] * factor
    return np.asarray((np.einsum('ij,jn->in', first[:3, :3], moved) + first[:3, 3:]).T)
