"""What one training sample is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np
from jaxtyping import Float

from gcl_core.models.backbone import Inputs


@dataclass(frozen=True)
class Sample(Generic[Inputs]):
    """A centre scan (first) and its neighbours, ready for the network.

    Attributes:
        inputs: of all scans, each turned by its augmentation; voxels until they are prepared.
        T_centre_scan: from each turned scan's frame to the centre's own.
    """

    inputs: Inputs
    T_centre_scan: Float[np.ndarray, 's 4 4']
