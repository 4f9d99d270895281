"""What trainer, registrar and benchmarks know of a network: one contract for every backbone."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Generic, Protocol, TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from gcl_core import se3
from gcl_core.ops.ground import height_above_ground
from gcl_core.ops.heading import dominant_heading
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import Features, PointCloud, SparseTensor

HEIGHT_SCALE = 3.0  # metres; brings heights of cars and eaves to the size of the constant input
HEIGHT_LIMIT = 12.0  # metres; above it a tree is a tree
QUARTER = math.pi / 2
# (4, 4, 4) turns about z by 0, 1, 2 and 3 quarters, without rounding.
QUARTER_TURNS = np.rint([se3.from_xyz_rpy(yaw=q * QUARTER) for q in range(4)])


@dataclass(frozen=True)
class BackboneConfig:
    """What the config of every backbone has, besides `backbone`, the name it is chosen by.

    Attributes:
        voxel_size: edge of an input voxel, metres.
        max_range: points beyond it are left out, metres.
        descriptor: length of a descriptor.
        height_input: add the height above the local ground to the constant 1 of the paper.
        align: scans are turned to their dominant heading before they are described
            (`ops.heading`); whoever describes does it, knowing what else is to be turned.
        max_yaw_deg: largest difference in heading between two described scans that trained
            weights bear.
    """

    voxel_size: float = 0.3
    max_range: float = 80.0
    descriptor: int = 32
    height_input: bool = False
    align: bool = False
    max_yaw_deg: float = 40.0


class Prepared(Protocol):
    """Scans as a network takes them."""

    def to(self, device: torch.device) -> Prepared:
        """Copy to a device, or return itself if it is there."""


Inputs = TypeVar('Inputs', bound=Prepared)
Config = TypeVar('Config', bound=BackboneConfig)


class Backbone(nn.Module, ABC, Generic[Config, Inputs]):
    """Describes scans: clouds -> voxels -> inputs -> points and descriptors.

    Attributes:
        config: shape of the network.
        dtype: in which it computes.
    """

    def __init__(self, config: Config) -> None:
        super().__init__()
        self.config = config
        self.dtype = torch.float32

    def facing(self, cloud: PointCloud) -> Float[np.ndarray, '4 4']:
        """T_view_lidar, what turns a scan to its street; the identity if not `config.align`."""
        if not self.config.align:
            return np.eye(4)
        return se3.from_xyz_rpy(yaw=-dominant_heading(cloud.points))

    def voxelize(self, clouds: Sequence[PointCloud]) -> SparseTensor:
        """Bring scans onto the first grid, with the network's input features.

        Raises:
            GclError: a scan has no point within `max_range`.
        """
        config = self.config
        voxels = voxelize(clouds, voxel_size=config.voxel_size, max_range=config.max_range)
        if not config.height_input:
            return voxels
        height = height_above_ground(voxels.points, voxels.keys >> 48)
        height = height.clamp(-1.0, HEIGHT_LIMIT) / HEIGHT_SCALE
        features = torch.cat([voxels.features, height.unsqueeze(1)], 1)
        return SparseTensor(voxels.keys, voxels.points, features, voxels.splits)

    @abstractmethod
    def prepare(self, voxels: SparseTensor) -> Inputs:
        """Do what a data loader can do, on the CPU, while the network computes."""

    @abstractmethod
    def forward(
        self, inputs: Inputs
    ) -> tuple[Float[torch.Tensor, 'm 3'], Float[torch.Tensor, 'm d'], tuple[int, ...]]:
        """Return points, unit descriptors and scan splits at the output's resolution."""

    def describe(self, clouds: Sequence[PointCloud]) -> list[Features]:
        """Describe each scan by itself; key points lie in its own sensor frame.

        Raises:
            GclError: a scan has no point within `max_range`.
        """
        return self.describe_prepared(self.prepare(self.voxelize(clouds)))

    def describe_prepared(self, inputs: Inputs) -> list[Features]:
        """Describe each scan of what `prepare` returned."""
        device = next(self.parameters()).device
        with torch.inference_mode():
            points, descriptors, splits = self(inputs.to(device))
        return [Features(points[a:b], descriptors[a:b]) for a, b in pairwise(splits)]

    def describe_facing(
        self, cloud: PointCloud, T_view_lidar: Float[np.ndarray, '4 4']
    ) -> Features:
        """Describe a scan turned to a view, such as `facing`; key points lie in its own frame.

        Raises:
            GclError: the scan has no point within `max_range`.
        """
        seen = self.describe([cloud.moved(T_view_lidar)])[0]
        own = se3.transform(se3.inverse(T_view_lidar), seen.points.numpy())
        return Features(torch.from_numpy(own), seen.descriptors)

    def describe_turned(self, cloud: PointCloud, yaws: Sequence[float]) -> list[Features]:
        """Describe a scan turned by each of some headings, radians, in the turned frames.

        Raises:
            GclError: the scan has no point within `max_range`.
        """
        quarters_by_rest: dict[float, list[int]] = {}
        places = []  # which quarter turn of which rest each heading is
        for quarters in (yaw / QUARTER for yaw in yaws):
            rest = round(quarters % 1, 9) % 1  # what 1 - 1e-12 leaves is 0
            turns = quarters_by_rest.setdefault(rest, [])
            places.append((rest, len(turns)))
            turns.append(round(quarters - rest))
        described = {}
        for rest, turns in quarters_by_rest.items():
            T_turned_lidar = se3.from_xyz_rpy(yaw=rest * QUARTER)
            turned = cloud.moved(T_turned_lidar)
            described[rest] = self.describe_quarters(turned, turns)
        return [described[rest][place] for rest, place in places]

    def describe_quarters(self, cloud: PointCloud, quarters: Sequence[int]) -> list[Features]:
        """Describe a scan turned by each of some numbers of quarter turns, in the turned frames.

        Raises:
            GclError: the scan has no point within `max_range`.
        """
        turned = (cloud.moved(QUARTER_TURNS[q % 4]) for q in quarters)
        return [features for scan in turned for features in self.describe([scan])]
