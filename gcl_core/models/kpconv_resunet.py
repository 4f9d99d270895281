"""GCL+KPConv: a Res-UNet of rigid kernel point convolutions (paper, "Network Structure")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import torch
from jaxtyping import Float
from torch import nn

from gcl_core.errors import GclError
from gcl_core.models.backbone import QUARTER_TURNS, Backbone, BackboneConfig, turned_back
from gcl_core.models.blocks import Linear
from gcl_core.models.kpconv_blocks import BOTTLENECK, ConvNorm, ResidualBlock, Unary, leaky
from gcl_core.ops.kernel_points import kernel_points
from gcl_core.ops.kpconv import Influences, influences
from gcl_core.ops.point_pyramid import PointPyramid, build_point_pyramid
from gcl_core.ops.quarter_turns import TURNS, QuarterTurnLinear
from gcl_core.types import Features, PointCloud, SparseTensor

# Mean distance of the kernel points from their centre, in extents (KPConv, section 3.2; public
# code: 0.66 of the radius, which is 1.4 here).
SHELL = 1.5


@dataclass(frozen=True)
class KPConvConfig(BackboneConfig):
    """Shape of the network; the defaults are the paper's GCL+KPConv.

    Attributes:
        backbone: chooses this network in a config.
        width: channels of the first residual block; it doubles from level to level.
        levels: grids; the first has the size of a voxel, each further one twice the last's.
        output_level: grid of the features: 0 for the first (the paper), 1 for one of twice the
            size, which costs less than half.
        decoder_blocks: a residual block after each step up but the last, which makes the decoder
            mirror the encoder as the paper says; without them it is KP-FCNN, as in public code.
        radius: of a neighbourhood, cells.
        extent: distance from a kernel point at which its influence ends, cells.
        kernel: kernel points, one of them in the centre; in orbits with `quarter_turns`.
        limits: most neighbours in each level, from
            `python -m gcl_core.training.neighbor_limits`.
    """

    backbone: Literal['kpconv'] = 'kpconv'
    width: int = 128
    levels: int = 4
    output_level: int = 0
    decoder_blocks: bool = True
    radius: float = 4.25
    extent: float = 2.0
    kernel: int = 15
    limits: tuple[int, ...] = (60, 66, 70, 75)

    def __post_init__(self) -> None:
        if len(self.limits) != self.levels or min(self.limits) < 1:
            raise GclError(
                f'network.limits is {self.limits}: give one positive number for each of '
                f'{self.levels} levels, see `python -m gcl_core.training.neighbor_limits`'
            )
        if self.width < 2 or self.kernel < 1:
            raise GclError(
                f'network.width is {self.width} and kernel {self.kernel}; the least are 2 and 1'
            )
        odd = [width for width in (self.width // 2, self.descriptor) if width % TURNS]
        if self.quarter_turns and (odd or self.width // BOTTLENECK % TURNS):
            raise GclError(
                f'network.width is {self.width} and descriptor {self.descriptor}; quarter_turns '
                f'needs multiples of {TURNS * BOTTLENECK} and {TURNS}'
            )
        if not 0 <= self.output_level < self.levels - 1:
            raise GclError(
                f'network.output_level is {self.output_level}; choose from 0 to {self.levels - 2}'
            )


class KPConvResUNet(Backbone[KPConvConfig, PointPyramid]):
    """Describe scans by kernel point convolutions over subsampled points."""

    def __init__(self, config: KPConvConfig) -> None:
        super().__init__(config)
        kernel, widths = config.kernel, [config.width << i for i in range(config.levels)]
        turns = config.quarter_turns
        points = torch.from_numpy(kernel_points(kernel, in_orbits=turns)).float()
        self.register_buffer('kernel_points', points)
        self.stem = ConvNorm(
            1 + config.height_input, config.width // 2, kernel, quarter_turns=turns, lifts=turns
        )
        self.encode, self.down = nn.ModuleList(), nn.ModuleList()
        width, skips = config.width // 2, []
        for level, wide in enumerate(widths):
            blocks = nn.ModuleList()
            # A level below the output's has no block: nothing reads it at full resolution again.
            for _ in range((1 if level == 0 else 2) if level >= config.output_level else 0):
                blocks.append(ResidualBlock(width, wide, kernel, quarter_turns=turns))
                width = wide
            self.encode.append(blocks)
            skips.append(width)
            if level < config.levels - 1:
                self.down.append(ResidualBlock(width, wide, kernel, quarter_turns=turns))
                width = wide
        self.up, self.decode = nn.ModuleList(), nn.ModuleList()
        for level in range(config.levels - 2, config.output_level - 1, -1):
            joined, width = width + skips[level], widths[level]
            if level == config.output_level:
                linear = QuarterTurnLinear if turns else Linear
                self.head = linear(joined, config.descriptor, bias=True)
                continue
            self.up.append(Unary(joined, width, quarter_turns=turns))
            if config.decoder_blocks:
                self.decode.append(ResidualBlock(width, width, kernel, quarter_turns=turns))

    def prepare(self, voxels: SparseTensor) -> PointPyramid:
        """Subsample and search for neighbours: the network's part of data preparation."""
        config = self.config
        return build_point_pyramid(
            voxels, cell=config.voxel_size, reach=config.radius, limits=config.limits
        )

    def describe_quarters(self, cloud: PointCloud) -> list[Features]:
        """Describe as `Backbone` does; without `quarter_turns` neighbours are searched once."""
        if self.config.quarter_turns:
            return super().describe_quarters(cloud)
        prepared, described = self.prepare(self.voxelize([cloud])), []
        for quarter, T_turned_lidar in enumerate(QUARTER_TURNS):
            (seen,) = self.describe_prepared(prepared.turned(quarter))
            described.append(Features(turned_back(seen.points, T_turned_lidar), seen.descriptors))
        return described

    def forward(
        self, inputs: PointPyramid
    ) -> tuple[Float[torch.Tensor, 'm 3'], Float[torch.Tensor, 'm d'], tuple[int, ...]]:
        """Return points, unit descriptors and scan splits at the output's grid."""
        config, last = self.config, self.config.levels - 1
        same = [self._felt(inputs, i, i) for i in range(config.levels)]
        x = self.stem(inputs.features.to(self.dtype), same[0])
        skips = []
        for level, blocks in enumerate(self.encode):
            for block in cast(nn.ModuleList, blocks):
                x = block(x, same[level])
            skips.append(x)
            if level < last:
                felt = self._felt(inputs, level + 1, level)
                x = self.down[level](x, felt, inputs.down[level])
        for step, level in enumerate(range(last - 1, config.output_level - 1, -1)):
            x = self.join(x[inputs.up[level]], skips[level])
            if level > config.output_level:
                x = leaky(self.up[step](x))
                if config.decoder_blocks:
                    x = self.decode[step](x, same[level])
        output = config.output_level
        descriptors = nn.functional.normalize(self.head(x.float()), dim=1)
        return inputs.points[output], descriptors, inputs.splits[output]

    def _felt(self, inputs: PointPyramid, outputs: int, level: int) -> Influences:
        """Influences of a level's points on themselves or on those of the next level."""
        config = self.config
        table = inputs.same[level] if outputs == level else inputs.down[level]
        extent = config.extent * config.voxel_size * 2**level
        kernel = self.kernel_points * (SHELL * extent)
        return influences(inputs.points[outputs], inputs.points[level], table, kernel, extent)
