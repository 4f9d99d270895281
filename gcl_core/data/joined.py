"""Two vehicles of one world as one sequence, so that pairs between them can be drawn."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core.data.sequence import Sequence
from gcl_core.types import PointCloud


class JoinedSequence:
    """Implements `gcl_core.data.sequence.Sequence`: the scans of several drives in a row.

    Args:
        name: of the whole.
        drives: in one world frame.
        sensors: name of each drive's sensor.

    Attributes:
        drives: number of the drive that each scan is of.
    """

    def __init__(self, name: str, drives: list[Sequence], sensors: list[str]) -> None:
        self.name = name
        self._scans = [
            (drive, i, sensor)
            for drive, sensor in zip(drives, sensors, strict=True)
            for i in range(len(drive))
        ]
        self.drives = np.repeat(np.arange(len(drives)), [len(drive) for drive in drives])

    def __len__(self) -> int:
        return len(self._scans)

    def scan(self, index: int) -> PointCloud:
        """Read one scan."""
        drive, i, _ = self._scans[index]
        return drive.scan(i)

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the sensor at that scan."""
        drive, i, _ = self._scans[index]
        return drive.T_world_lidar(i)

    def sensor(self, index: int) -> str:
        """Name of the sensor that saw a scan."""
        return self._scans[index][2]
