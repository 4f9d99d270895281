"""KITTI odometry: `sequences/NN/velodyne/*.bin`, `calib.txt`, `poses/NN.txt`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.clouds import CloudReader
from gcl_core.data.poses import is_rigid, read_poses, read_table
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

LAYOUT = 'KITTI odometry is laid out as sequences/NN/velodyne/*.bin beside poses/NN.txt'
PoseSource = Literal['auto', 'kitti', 'semantickitti']


class KittiSequence:
    """Implements `gcl_core.data.sequence.Sequence`.

    Both files of poses hold the left camera's; `Tr` of `calib.txt` brings LiDAR points into the
    camera frame, so that the world is the first camera's frame turned to LiDAR axes.
    KITTI's own poses (`poses/NN.txt`, from GPS) jump at the start of 00 and in 08; the public code
    of the paper takes SemanticKITTI's (`sequences/NN/poses.txt`, from SuMa, a LiDAR SLAM).

    Where there is no folder `velodyne`, poses are what there is: enough to draw pairs by distance.

    Attributes:
        clouds: reads the files; to be replaced where the columns of `.bin` files are told.
        files: of the scans, in their order; none where there are poses alone.

    Args:
        root: folder that holds `sequences` and `poses`.
        sequence: two digits, such as `08`.
        poses: whose; `auto` takes KITTI's own, or SemanticKITTI's where only those exist. The
            name says so when they are SemanticKITTI's: `kitti/08-suma`.

    Raises:
        GclError: something is missing or malformed; the message says what was expected where.
    """

    def __init__(self, root: Path, sequence: str, poses: PoseSource = 'auto') -> None:
        folder = root / 'sequences' / sequence
        self._folder = folder / 'velodyne'
        self.clouds = CloudReader()
        if not folder.is_dir():
            raise GclError(f'no folder {folder}; {LAYOUT}')
        self.files = sorted(self._folder.glob('*.bin'))
        own, suma = root / 'poses' / f'{sequence}.txt', folder / 'poses.txt'
        takes_suma = poses == 'semantickitti' or (
            poses == 'auto' and suma.is_file() and not own.is_file()
        )
        self.name = f'kitti/{sequence}-suma' if takes_suma else f'kitti/{sequence}'
        self._poses = lidar_poses(suma if takes_suma else own, folder / 'calib.txt')
        if self._folder.is_dir() and len(self._poses) != len(self.files):
            raise GclError(
                f'{self.name}: {len(self.files)} scans but {len(self._poses)} poses; '
                'the download is incomplete'
            )

    def __len__(self) -> int:
        return len(self._poses)

    def scan(self, index: int) -> PointCloud:
        """Read one scan.

        Raises:
            GclError: there are poses alone, or the file is damaged.
        """
        if not self.files:
            raise GclError(f'no folder {self._folder}; {LAYOUT}')
        return self.clouds(self.files[index])

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the LiDAR; the first scan of the drive is near the identity."""
        return self._poses[index]

    def times(self) -> Float[np.ndarray, ' n']:
        """Seconds of each scan, from `times.txt`.

        Raises:
            GclError: missing, or not one number for each scan.
        """
        path = self._folder.with_name('times.txt')
        times = read_table(path, 1)[:, 0]
        if len(times) != len(self):
            raise GclError(f'{path} has {len(times)} times, but there are {len(self)} scans')
        return times


def lidar_poses(poses: Path, calibration: Path) -> Float[np.ndarray, 'n 4 4']:
    """Read camera poses and turn them into the LiDAR's: `inv(Tr) T_world_camera Tr`."""
    T_camera_lidar = read_calibration(calibration)
    return np.asarray(se3.inverse(T_camera_lidar) @ read_poses(poses) @ T_camera_lidar)


def read_calibration(path: Path) -> Float[np.ndarray, '4 4']:
    """Read `Tr`, the pose of the LiDAR in the camera frame.

    Raises:
        GclError: missing or malformed.
    """
    try:
        lines = path.read_text(errors='replace').splitlines()
    except OSError:
        raise GclError(f'no file {path}; it belongs to the KITTI odometry download') from None
    for line in lines:
        key, _, numbers = line.partition(':')
        if key.strip() == 'Tr':
            try:
                values = np.array(numbers.split(), dtype=float)
            except ValueError as error:
                raise GclError(f'{path}: Tr: {error}') from None
            if values.shape != (12,):
                raise GclError(f'{path}: Tr has {len(values)} numbers, expected 12')
            T = np.vstack([values.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
            if not is_rigid(T):
                raise GclError(f'{path}: Tr is no rigid motion; expected [R | t] row by row')
            return T
    raise GclError(f'{path} has no line `Tr:`; it belongs to another KITTI download')
