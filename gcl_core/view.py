"""One scan, ready to be registered to others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from gcl_core.estimation.refine import Prepared, RefineConfig, prepare
from gcl_core.estimation.surface import Surface, surface
from gcl_core.types import Features, PointCloud


@dataclass(frozen=True)
class View:
    """One scan, ready to be registered to others; made once per scan.

    Attributes:
        T_view_lidar: turns the scan to its street; all else is in the frame that it leads to.
        headings: features in the frames turned by `turns`; none yet of `undescribed`.
        turns: T_turned_view of each heading; the identity alone where it is a target.
        surface: for checks.
        prepared: for refinement.
        points: number of them.
    """

    T_view_lidar: Float[np.ndarray, '4 4']
    headings: list[Features]
    turns: Float[torch.Tensor, 'turns 4 4']
    surface: Surface
    prepared: Prepared
    points: int


def undescribed(
    cloud: PointCloud, T_view_lidar: Float[np.ndarray, '4 4'], config: RefineConfig
) -> View:
    """All of a view that does not depend on headings.

    Raises:
        GclError: no point lies within 80 m.
    """
    cloud = cloud.moved(T_view_lidar)
    return View(
        T_view_lidar=T_view_lidar,
        headings=[],
        turns=torch.empty(0, 4, 4, dtype=torch.float64),
        surface=surface(cloud),
        prepared=prepare(cloud, config),
        points=len(cloud),
    )
