"""A recorded drive whose scans still carry the vehicle's own motion, straightened by its poses.

At 10 m/s a sweep of 0.1 s is bent by 1 m. KITTI odometry's scans are straightened already, those
of KITTI's raw drives are not (Dellenbach et al., "CT-ICP", ICRA 2022).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError
from gcl_core.ops.deskew import between, deskewed
from gcl_core.types import PointCloud

LONGEST_SWEEP = 1.0  # seconds; 0.05 to 0.2 are common
LONGEST_GAP = 1.0  # seconds between scans that tell the speed


class DeskewedSequence:
    """Implements `gcl_core.data.sequence.Sequence`: each scan as if seen at once.

    Speed and turn rate are those between the scans before and after. Points carry no times here:
    the sensor turns evenly and looks ahead (+x) at the time of its pose, as Velodynes do in KITTI.

    Args:
        drive: what was recorded.
        times: seconds of each of its scans.
        sweep: seconds of a full turn; negative of a sensor that turns counter-clockwise, seen from
            above.

    Raises:
        GclError: there is but one scan, scans are too far apart in time to tell the speed, or the
            sweep is none of a LiDAR.
    """

    def __init__(self, drive: Sequence, times: Float[np.ndarray, ' n'], *, sweep: float) -> None:
        self.name = f'{drive.name}, de-skewed'
        self._drive, self._times, self._sweep = drive, times, sweep
        if not 0 < abs(sweep) <= LONGEST_SWEEP:
            raise GclError(
                f'a sweep of {sweep:g} s; expected seconds up to {LONGEST_SWEEP:g}, such as 0.1'
            )
        gaps = np.diff(times)
        if not len(gaps) or gaps.min() <= 0 or gaps.max() > LONGEST_GAP:
            told = f'{gaps.min():.3g} to {gaps.max():.3g} s apart' if len(gaps) else 'alone'
            raise GclError(
                f'{drive.name}: a scan is de-skewed by the speed between its neighbours, '
                f'0 to {LONGEST_GAP:g} s apart; these scans are {told}'
            )

    def __len__(self) -> int:
        return len(self._drive)

    def scan(self, index: int) -> PointCloud:
        """Read one scan; its points in the sensor's frame at the time of its pose."""
        points = self._drive.scan(index).points
        before, after = max(index - 1, 0), min(index + 1, len(self) - 1)
        stamps = self._times[[before, after]] - self._times[index]
        moved = se3.inverse(self.T_world_lidar(before)) @ self.T_world_lidar(after)
        share = -np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi)  # of a turn, clockwise
        start = se3.inverse(between(np.eye(4), moved, -stamps[0] / (stamps[1] - stamps[0])))
        straight = deskewed(
            points,
            share * self._sweep,
            stamps=stamps,
            T_ref_lidar=np.stack([start, start @ moved]),
        )
        return PointCloud(straight)

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the sensor at that scan."""
        return self._drive.T_world_lidar(index)
