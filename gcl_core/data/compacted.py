"""A drive whose scans have been through a compact scan, as another vehicle receives them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.data.sequence import Sequence
from gcl_core.types import PointCloud


class CompactedSequence:
    """Implements `gcl_core.data.sequence.Sequence`.

    Args:
        drive: whose scans are sent.
        config: how.
    """

    def __init__(self, drive: Sequence, config: CompactConfig) -> None:
        self.name = f'{drive.name}, compact'
        self._drive, self._config = drive, config

    def __len__(self) -> int:
        return len(self._drive)

    def scan(self, index: int) -> PointCloud:
        """Write one scan and read it."""
        return decode(encode(self._drive.scan(index), self._config), f'{self.name}/{index}')

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the sensor at that scan."""
        return self._drive.T_world_lidar(index)
