"""Building blocks of the KPConv Res-UNet (Thomas et al., KP-FCNN, ICCV 2019)."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int32
from torch import nn

from gcl_core.ops.kpconv import Influences, KPConv, convolve
from gcl_core.ops.neighbor_max import neighbor_max
from gcl_core.ops.sparse_conv import scale_and_shift

BN_MOMENTUM = 0.02  # of the public code
SLOPE = 0.1  # of the leaky ReLU; paper, figure "Network structures for GCL"
BOTTLENECK = 4  # a residual block convolves a quarter of its channels


def leaky(x: Float[torch.Tensor, 'n c']) -> Float[torch.Tensor, 'n c']:
    """Leaky ReLU."""
    return nn.functional.leaky_relu(x, SLOPE)


class _Normed(nn.Module):
    """A product with a batch norm behind it; in inference one product, the norm folded in."""

    norm: nn.BatchNorm1d

    def __init__(self) -> None:
        super().__init__()
        self._folded: dict[torch.dtype, tuple[torch.Tensor, torch.Tensor]] = {}

    def train(self, mode: bool = True) -> _Normed:
        """Switch mode; what was folded for inference is forgotten, the weights may change."""
        self._folded.clear()
        return super().train(mode)

    def folded(
        self, weight: Float[torch.Tensor, '... c_out'], dtype: torch.dtype
    ) -> tuple[Float[torch.Tensor, '... c_out'], Float[torch.Tensor, ' c_out']] | None:
        """Weight and bias of the one product; none while gradients are wanted."""
        if self.training or torch.is_grad_enabled():
            return None
        if dtype not in self._folded:
            scale, bias = scale_and_shift(self.norm)
            self._folded[dtype] = (weight.detach() * scale).to(dtype), bias.to(dtype)
        return self._folded[dtype]


class Unary(_Normed):
    """Linear layer point by point, batch norm."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(in_channels, out_channels, bias=False)
        self.norm = nn.BatchNorm1d(out_channels, momentum=BN_MOMENTUM)

    def forward(self, x: Float[torch.Tensor, 'n c_in']) -> Float[torch.Tensor, 'n c_out']:
        """Compute in the dtype of `x`."""
        weight = self.linear.weight.t()
        if folded := self.folded(weight, x.dtype):
            return torch.addmm(folded[1], x, folded[0])
        out: torch.Tensor = self.norm(x @ weight.to(x.dtype))
        return out


class ConvNorm(_Normed):
    """KPConv, batch norm, leaky ReLU: the paper's "simple" block."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int) -> None:
        super().__init__()
        self.conv = KPConv(in_channels, out_channels, kernel)
        self.norm = nn.BatchNorm1d(out_channels, momentum=BN_MOMENTUM)

    def forward(
        self, x: Float[torch.Tensor, 'n c_in'], felt: Influences
    ) -> Float[torch.Tensor, 'm c_out']:
        """Convolve from the points of `x` to the outputs of `felt`."""
        if folded := self.folded(self.conv.weight, x.dtype):
            return leaky(convolve(x, folded[0], felt) + folded[1])
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
