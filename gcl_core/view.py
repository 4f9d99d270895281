"""One scan, ready to be registered to others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcl_core.estimation.refine import Prepared
from gcl_core.estimation.surface import Surface
from gcl_core.types import Features, Heading, PointCloud


@dataclass(frozen=True)
class View:
    """One scan, ready to be registered to others; made once per scan, whatever its part.

    Attributes:
        T_view_lidar: turns the scan to its street; all else is in the frame that it leads to.
        cloud: its points.
        headings: how it is described, first as it is, then as turned.
        surface: for checks.
        prepared: for refinement.
    """

    T_view_lidar: Float[np.ndarray, '4 4']
    cloud: PointCloud
    headings: tuple[Heading, ...]
    surface: Surface
    prepared: Prepared

    @property
    def features(self) -> Features:
        """How it is described as it is."""
        return self.headings[0].features
