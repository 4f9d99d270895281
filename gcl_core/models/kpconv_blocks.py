"""Building blocks of the KPConv Res-UNet (Thomas et al., KP-FCNN, ICCV 2019)."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int32
from torch import nn

from gcl_core.ops.kpconv import Influences, KPConv
from gcl_core.ops.neighbor_max import neighbor_max

BN_MOMENTUM = 0.02  # of the public code
SLOPE = 0.1  # of the leaky ReLU; paper, figure "Network structures for GCL"
BOTTLENECK = 4  # a residual block convolves a quarter of its channels


def leaky(x: Float[torch.Tensor, 'n c']) -> Float[torch.Tensor, 'n c']:
    """Leaky ReLU."""
    return nn.functional.leaky_relu(x, SLOPE)


class Unary(nn.Module):
    """Linear layer point by point, batch norm."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(in_channels, out_channels, bias=False)
        self.norm = nn.BatchNorm1d(out_channels, momentum=BN_MOMENTUM)

    def forward(self, x: Float[torch.Tensor, 'n c_in']) -> Float[torch.Tensor, 'n c_out']:
        """Compute in the dtype of `x`."""
        weight = self.linear.weight.to(x.dtype)
        out: torch.Tensor = self.norm(nn.functional.linear(x, weight))
        return out


class ConvNorm(nn.Module):
    """KPConv, batch norm, leaky ReLU: the paper's "simple" block."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int) -> None:
        super().__init__()
        self.conv = KPConv(in_channels, out_channels, kernel)
        self.norm = nn.BatchNorm1d(out_channels, momentum=BN_MOMENTUM)

    def forward(
        self, x: Float[torch.Tensor, 'n c_in'], felt: Influences
    ) -> Float[torch.Tensor, 'm c_out']:
        """Convolve from the points of `x` to the outputs of `felt`."""
        return leaky(self.norm(self.conv(x, felt)))


class ResidualBlock(nn.Module):
    """1x1, KPConv on a quarter of the channels, 1x1, plus a shortcut: the paper's "resnetb".

    With a table of neighbours it goes down a level and the shortcut takes their maximum
    ("resnetb strided").
    """

    def __init__(self, in_channels: int, out_channels: int, kernel: int) -> None:
        super().__init__()
        narrow = max(1, out_channels // BOTTLENECK)
        self.reduce = Unary(in_channels, narrow)
        self.conv = ConvNorm(narrow, narrow, kernel)
        self.expand = Unary(narrow, out_channels)
        same = in_channels == out_channels
        self.shortcut = nn.Identity() if same else Unary(in_channels, out_channels)

    def forward(
        self,
        x: Float[torch.Tensor, 'n c_in'],
        felt: Influences,
        neighbors: Int32[torch.Tensor, 'm k'] | None = None,
    ) -> Float[torch.Tensor, 'm c_out']:
        """Convolve; `neighbors` are the inputs around each output if those are others."""
        out = self.expand(self.conv(leaky(self.reduce(x)), felt))
        short = x if neighbors is None else neighbor_max(x, neighbors)
        return leaky(out + self.shortcut(short))
