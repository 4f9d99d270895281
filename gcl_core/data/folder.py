"""A plain folder of clouds, with or without poses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core.data.clouds import FORMATS, CloudReader
from gcl_core.data.poses import read_poses
from gcl_core.errors import GclError
from gcl_core.types import PointCloud


class FolderSequence:
    """Implements `gcl_core.data.sequence.Sequence`.

    Clouds (.bin, .pcd, .ply, .npy, .gcl) are taken in the order of the numbers in their names.
    `poses.txt`, where present, holds a line for each: the LiDAR's pose as KITTI's 12 numbers.

    Attributes:
        clouds: reads the files; to be replaced where the columns of `.bin` files are told.
        files: of the scans, in their order.
        posed: whether there are poses.

    Raises:
        GclError: no cloud, clouds of several formats, or not one pose for each cloud.
    """

    def __init__(self, folder: Path) -> None:
        self.name = f'folder/{folder.resolve().name}'
        self._folder = folder
        self.clouds = CloudReader()
        found = [path for path in _listed(folder) if path.suffix.lower() in FORMATS]
        self.files = sorted(found, key=_natural)
        if not self.files:
            raise GclError(f'no cloud in {folder}; expected files {", ".join(FORMATS)}')
        kinds = sorted({path.suffix.lower() for path in self.files})
        if len(kinds) > 1:
            raise GclError(f'{folder} mixes {" and ".join(kinds)}; keep one format in a folder')
        poses = folder / 'poses.txt'
        self._poses = read_poses(poses) if poses.is_file() else None
        self.posed = self._poses is not None
        if self._poses is not None and len(self._poses) != len(self.files):
            raise GclError(f'{poses}: {len(self._poses)} poses for {len(self.files)} clouds')

    def __len__(self) -> int:
        return len(self.files)

    def scan(self, index: int) -> PointCloud:
        """Read one cloud."""
        return self.clouds(self.files[index])

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the LiDAR.

        Raises:
            GclError: there is no `poses.txt`.
        """
        if self._poses is None:
            raise GclError(
                f'no file {self._folder}/poses.txt: these clouds have no poses. '
                'Write one line of 12 numbers (3x4, row by row) for each cloud'
            )
        return self._poses[index]


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise GclError(f'cannot list {folder}: {error.strerror}') from None


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key: digits count as numbers, so that 2 comes before 10."""
    return [(int(p), '') if p.isdigit() else (0, p) for p in re.split(r'(\d+)', path.name)]
