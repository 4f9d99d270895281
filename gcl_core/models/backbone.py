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
from gcl_core.ops.quarter_turns import TURNS, join_blocks, roll_blocks
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import Features, Heading, PointCloud, SparseTensor

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
        quarter_turns: share filters over the quarter turns about z (`ops.quarter_turns`): a scan
            turned by 90 degrees has the same features, their four blocks rolled by one. All
            widths are of the four blocks together.
        max_yaw_deg: largest difference in heading between two described scans that trained
            weights bear.
    """

    voxel_size: float = 0.3
    max_range: float = 80.0
    descriptor: int = 32
    height_input: bool = False
    align: bool = False
    quarter_turns: bool = False
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

    def join(
        self, up: Float[torch.Tensor, 'n a'], skip: Float[torch.Tensor, 'n b']
    ) -> Float[torch.Tensor, 'n a+b']:
        """Concatenate channels, block by block with `quarter_turns`."""
        return join_blocks(up, skip) if self.config.quarter_turns else torch.cat([up, skip], 1)

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
        """Describe each scan of what `prepare` returned; features come back to the CPU."""
        device = next(self.parameters()).device
        with torch.inference_mode():
            points, descriptors, splits = self(inputs.to(device))
        points, descriptors = points.cpu(), descriptors.cpu()
        return [Features(points[a:b], descriptors[a:b]) for a, b in pairwise(splits)]

    def describe_facing(
        self, cloud: PointCloud, T_view_lidar: Float[np.ndarray, '4 4']
    ) -> Features:
        """Describe a scan turned to a view, such as `facing`; key points lie in its own frame.

        Raises:
            GclError: the scan has no point within `max_range`.
        """
        (seen,) = self.describe([cloud.moved(T_view_lidar)])
        return Features(turned_back(seen.points, T_view_lidar), seen.descriptors)

    def describe_headings(self, cloud: PointCloud, yaw: float = 0.0) -> list[Heading]:
        """Describe a scan as turned by `yaw`, radians, and by the three quarter turns after it.

        Raises:
            GclError: the scan has no point within `max_range`.
        """
        T_turned_lidar = se3.from_xyz_rpy(yaw=yaw)
        quarters = self.describe_quarters(cloud.moved(T_turned_lidar) if yaw else cloud)
        headings = []
        for quarter, seen in enumerate(quarters):
            points = seen.points
            if yaw:
                points = turned_back(points, T_turned_lidar)
            headings.append(Heading(yaw + quarter * QUARTER, Features(points, seen.descriptors)))
        return headings

    def describe_quarters(self, cloud: PointCloud) -> list[Features]:
        """Describe a scan as turned by each of the four quarter turns; key points stay unturned.

        Raises:
            GclError: the scan has no point within `max_range`.
        """
        if self.config.quarter_turns:
            (own,) = self.describe([cloud])
            return [Features(own.points, roll_blocks(own.descriptors, q)) for q in range(TURNS)]
        described = []
        for T_turned_lidar in QUARTER_TURNS:
            (seen,) = self.describe([cloud.moved(T_turned_lidar)])
            described.append(Features(turned_back(seen.points, T_turned_lidar), seen.descriptors))
        return described


def turned_back(
    points: Float[torch.Tensor, 'n 3'], T_turned_lidar: Float[np.ndarray, '4 4']
) -> Float[torch.Tensor, 'n 3']:
    """Key points of a scan that was moved, in its own frame."""
    return torch.from_numpy(se3.transform(se3.inverse(T_turned_lidar), points.numpy()))
