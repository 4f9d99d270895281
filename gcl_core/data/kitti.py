"""KITTI odometry: `sequences/NN/velodyne/*.bin`, `calib.txt`, `times.txt`, `poses/NN.txt`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.clouds import read_cloud
from gcl_core.errors import GclError
from gcl_core.types import PointCloud


class KittiSequence:
    """Implements `gcl_core.data.sequence.Sequence`.

    Poses in `poses/NN.txt` are the left camera's; `Tr` of `calib.txt` brings LiDAR points into
    the camera frame, so that the world is the first camera's frame turned to LiDAR axes.

    Args:
        root: folder that holds `sequences` and `poses`.
        sequence: two digits, such as `08`.

    Raises:
        GclError: something is missing or malformed; the message says what was expected where.
    """

    def __init__(self, root: Path, sequence: str) -> None:
        self.name = f'kitti/{sequence}'
        folder = root / 'sequences' / sequence
        for expected in (folder, folder / 'velodyne'):
            if not expected.is_dir():
                raise GclError(
                    f'no folder {expected}; KITTI odometry is laid out as '
                    'sequences/NN/velodyne/*.bin beside poses/NN.txt'
                )
        self._scans = sorted((folder / 'velodyne').glob('*.bin'))
        self._times = read_times(folder / 'times.txt')
        T_camera_lidar = read_calibration(folder / 'calib.txt')
        T_world_camera = read_poses(root / 'poses' / f'{sequence}.txt')
        if len(T_world_camera) != len(self._scans):
            raise GclError(
                f'{self.name}: {len(self._scans)} scans but {len(T_world_camera)} poses; '
                'the download is incomplete'
            )
        T_lidar_camera = se3.inverse(T_camera_lidar)
        self._poses = [T_lidar_camera @ T @ T_camera_lidar for T in T_world_camera]

    def __len__(self) -> int:
        return len(self._scans)

    def scan(self, index: int) -> PointCloud:
        """Read one scan."""
        return read_cloud(self._scans[index])

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the LiDAR; the first scan of the drive is near the identity."""
        return self._poses[index]

    def stamp(self, index: int) -> float:
        """Seconds since the first scan."""
        return float(self._times[index])


def _read_table(path: Path, columns: int) -> Float[np.ndarray, 'n c']:
    try:
        table = np.loadtxt(path, ndmin=2)
    except OSError:
        raise GclError(f'no file {path}; it belongs to the KITTI odometry download') from None
    except ValueError as error:
        raise GclError(f'{path}: {error}') from None
    if table.ndim != 2 or table.shape[1] != columns:
        raise GclError(f'{path}: expected {columns} numbers a line, got {table.shape[1]}')
    if not np.isfinite(table).all():
        raise GclError(f'{path} holds a number that is not finite')
    return table


def read_poses(path: Path) -> list[Float[np.ndarray, '4 4']]:
    """Read one 3x4 pose a line."""
    rows = _read_table(path, 12).reshape(-1, 3, 4)
    return [np.vstack([row, [0.0, 0.0, 0.0, 1.0]]) for row in rows]


def read_times(path: Path) -> Float[np.ndarray, ' n']:
    """Read one time a line, seconds."""
    return _read_table(path, 1)[:, 0]


def read_calibration(path: Path) -> Float[np.ndarray, '4 4']:
    """Read `Tr`, the pose of the LiDAR in the camera frame."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        raise GclError(f'no file {path}; it belongs to the KITTI odometry download') from None
    for line in lines:
        key, _, numbers = line.partition(':')
        if key.strip() == 'Tr':
            values = np.array(numbers.split(), dtype=float)
            if values.shape != (12,):
                raise GclError(f'{path}: Tr has {len(values)} numbers, expected 12')
            return np.vstack([values.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    raise GclError(f'{path} has no line `Tr:`; it belongs to another KITTI download')
