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
from gcl_core.models.blocks import ConvNorm, ResidualBlock
from gcl_core.ops.kernel_map import build_pyramid
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
    """

    backbone: Literal['conv'] = 'conv'
    encoder: tuple[int, ...] = (32, 64, 128, 256)
    decoder: tuple[int, ...] = (256, 128, 128)
    head: int = 128

    def __post_init__(self) -> None:
        if len(self.decoder) >= len(self.encoder):
            raise GclError(
                f'network.decoder has {len(self.decoder)} steps up, network.encoder '
                f'{len(self.encoder)} levels; there must be more levels than steps'
            )

    @property
    def output_level(self) -> int:
        """Pyramid level of the features; their stride is 2 to that power."""
        return len(self.encoder) - 1 - len(self.decoder)


class ResUNet(Backbone[ResUNetConfig, SparseTensor]):
    """Describe scans by one pass of convolutions over their occupied voxels."""

    STEM_KERNEL = 5

    def __init__(self, config: ResUNetConfig) -> None:
        super().__init__(config)
        encoder, last = config.encoder, len(config.encoder) - 1
        self.stem = ConvNorm(1 + config.height_input, encoder[0], self.STEM_KERNEL)
        self.down = nn.ModuleList(ConvNorm(a, b) for a, b in pairwise(encoder))
        # A level below the output's has no block: nothing reads it at full resolution again.
        self.encode = nn.ModuleList(
            ResidualBlock(width) if level >= config.output_level else nn.Identity()
            for level, width in enumerate(encoder)
        )
        self.up, self.decode = nn.ModuleList(), nn.ModuleList()
        width = encoder[last]
        for step, out in enumerate(config.decoder):
            self.up.append(ConvNorm(width, out))
            self.decode.append(ResidualBlock(out))
            width = out + encoder[last - 1 - step]
        self.head = nn.Sequential(
            nn.Linear(width, config.head, bias=False),
            nn.ReLU(),
            nn.Linear(config.head, config.descriptor),
        )

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
            stem_kernel=self.STEM_KERNEL,
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
            x = torch.cat([block(x, pyramid.same[level]), skips[level]], 1)
        descriptors = nn.functional.normalize(self.head(x.float()), dim=1)

        points = inputs.points
        for level in range(output):
            points = barycentres(points, pyramid.parent[level], len(pyramid.keys[level + 1]))
        scan = pyramid.keys[output] >> 48
        splits = torch.searchsorted(scan, torch.arange(len(inputs.splits), device=scan.device))
        return points, descriptors, tuple(splits.tolist())
