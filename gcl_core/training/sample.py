"""What one training sample is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcl_core.types import SparseTensor


@dataclass(frozen=True)
class Sample:
    """A centre scan (first) and its neighbours, ready for the network.

    Attributes:
        voxels: of all scans, each turned by its augmentation.
        T_centre_scan: from each turned scan's frame to the centre's own.
    """

    voxels: SparseTensor
    T_centre_scan: Float[np.ndarray, 's 4 4']
