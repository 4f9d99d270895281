"""GCL+Conv: a Res-UNet on sparse voxels (paper, section "Network Structure")."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import torch
from jaxtyping import Float
from torch import nn

from gcl_core.errors import GclError
from gcl_core.models.backbone import Backbone, BackboneConfig
from gcl_core.models.blocks import ConvNorm, Linear, ResidualBlock
from gcl_core.ops.kernel_map import KernelShape, build_pyramid
from gcl_core.ops.quarter_turns import TURNS, QuarterTurnLinear
from gcl_core.ops.voxelize import barycentres
from gcl_core.types import SparseTensor


@dataclass(frozen=True)
class ResUNetConfig(BackboneConfig):
    """Shape of the network; the defaults are the paper's GCL+Conv ("fat", about 15 M weights).

    Attributes:
        backbone: chooses this network in a config.
        encoder: channels at strides 1, 2, 4, 8.
        decoder: channels after each upsampling, coarsest first. As many as lead from stride 8
            to the output: three for features on the input voxels (the paper), two for features
            at stride 2, which cost a third.
        head: channels between the two 1x1 layers.
        block: kernel of the residual blocks: edge and height, voxels.
        stride_kernel: edge of the kernels at stride 2; even with `quarter_turns`, since an odd
            one is not symmetric on the grid of stride 2.
    """

    backbone: Literal['conv'] = 'conv'
    encoder: tuple[int, ...] = (32, 64, 128, 256)
    decoder: tuple[int, ...] = (256, 128, 128)
    head: int = 128
    block: tuple[int, int] = (3, 3)
    stride_kernel: int = 3

    def __post_init__(self) -> None:
        if any(length < 1 or length % 2 == 0 for length in self.block):
            raise GclError(f'network.block is {self.block}; its lengths must be odd')
        if self.stride_kernel < 2:
            raise GclError(f'network.stride_kernel is {self.stride_kernel}; take 2 or more')
        if self.quarter_turns:
            self._check_blocks()
        if len(self.decoder) >= len(self.encoder):
            raise GclError(
                f'network.decoder has {len(self.decoder)} steps up, network.encoder '
                f'{len(self.encoder)} levels; there must be more levels than steps'
            )

    def _check_blocks(self) -> None:
        """See that quarter turns leave the network as it is."""
        if self.stride_kernel % 2:
            raise GclError(
                f'network.stride_kernel is {self.stride_kernel}; it must be even with '
                'quarter_turns'
            )
        widths = (*self.encoder, *self.decoder, self.head, self.descriptor)
        if odd := [width for width in widths if width % TURNS]:
            raise GclError(
                f'network widths {odd} are no multiples of {TURNS}, which quarter_turns needs'
            )

    @property
    def output_level(self) -> int:
        """Pyramid level of the features; their stride is 2 to that power."""
        return len(self.encoder) - 1 - len(self.decoder)


class ResUNet(Backbone[ResUNetConfig, SparseTensor]):
    """Describe scans by one pass of convolutions over their occupied voxels."""

    STEM = KernelShape.cube(5)

    def __init__(self, config: ResUNetConfig) -> None:
        super().__init__(config)
        encoder, last, turns = config.encoder, len(config.encoder) - 1, config.quarter_turns
        self.stem = ConvNorm(
            1 + config.height_input, encoder[0], self.STEM, quarter_turns=turns, lifts=turns
        )
        self.down = nn.ModuleList(self._strided(a, b) for a, b in pairwise(encoder))
        # A level below the output's has no block: nothing reads it at full resolution again.
        self.encode = nn.ModuleList(
            self._block(width) if level >= config.output_level else nn.Identity()
            for level, width in enumerate(encoder)
        )
        self.up, self.decode = nn.ModuleList(), nn.ModuleList()
        width = encoder[last]
        for step, out in enumerate(config.decoder):
            self.up.append(self._strided(width, out))
            self.decode.append(self._block(out))
            width = out + encoder[last - 1 - step]
        linear = QuarterTurnLinear if turns else Linear
        self.head = nn.Sequential(
            linear(width, config.head, bias=False),
            nn.ReLU(),
            linear(config.head, config.descriptor, bias=True),
        )

    def _strided(self, in_channels: int, out_channels: int) -> ConvNorm:
        shape = KernelShape.cube(self.config.stride_kernel)
        turns = self.config.quarter_turns
        return ConvNorm(in_channels, out_channels, shape, quarter_turns=turns)

    def _block(self, channels: int) -> ResidualBlock:
        shape = KernelShape(*self.config.block)
        return ResidualBlock(channels, shape, quarter_turns=self.config.quarter_turns)

    def prepare(self, voxels: SparseTensor) -> SparseTensor:
        """Nothing: the kernel maps are made where the network computes."""
        return voxels

    def forward(
        self, inputs: SparseTensor
    ) -> tuple[Float[torch.Tensor, 'm 3'], Float[torch.Tensor, 'm d'], tuple[int, ...]]:
        """Return points, unit descriptors and scan splits at the output stride."""
        output = self.config.output_level
        pyramid = build_pyramid(
            inputs.keys,
            levels=len(self.config.encoder),
            stem=self.STEM,
            block=KernelShape(*self.config.block),
            down=self.config.stride_kernel,
            finest_block=output,
        )
        x = self.stem(inputs.features.to(self.dtype), pyramid.stem)
        skips = []
        for level, block in enumerate(self.encode):
            if level > 0:
                x = self.down[level - 1](x, pyramid.down[level - 1])
            if level >= output:
                x = block(x, pyramid.same[level])
            skips.append(x)
        for step, (up, block) in enumerate(zip(self.up, self.decode, strict=True)):
            level = len(skips) - 2 - step
            x = up(x, pyramid.down[level].transposed())
            x = self.join(block(x, pyramid.same[level]), skips[level])
        descriptors = nn.functional.normalize(self.head(x.float()), dim=1)

        points = inputs.points
        for level in range(output):
            points = barycentres(points, pyramid.parent[level], len(pyramid.keys[level + 1]))
        scan = pyramid.keys[output] >> 48
        splits = torch.searchsorted(scan, torch.arange(len(inputs.splits), device=scan.device))
        return points, descriptors, tuple(splits.tolist())
