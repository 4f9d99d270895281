"""The one protocol that every source of scans implements."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.types import PointCloud


class Sequence(Protocol):
    """A drive: scans in order, each with the pose of its sensor."""

    @property
    def name(self) -> str:
        """Short name for result tables, such as `kitti/08`."""

    def __len__(self) -> int:
        """Number of scans."""

    def scan(self, index: int) -> PointCloud:
        """Read one scan, metres, sensor frame."""

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the sensor at that scan."""


def T_target_source(sequence: Sequence, *, source: int, target: int) -> Float[np.ndarray, '4 4']:
    """True transform between two scans of a drive."""
    return se3.inverse(sequence.T_world_lidar(target)) @ sequence.T_world_lidar(source)


def positions(sequence: Sequence) -> Float[np.ndarray, 'n 3']:
    """Sensor positions of all scans, metres, world frame."""
    return np.stack([sequence.T_world_lidar(i)[:3, 3] for i in range(len(sequence))])
