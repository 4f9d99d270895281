"""Building blocks of the KPConv Res-UNet (Thomas et al., KP-FCNN, ICCV 2019)."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int32
from torch import nn

from gcl_core.models.folding import Folding
from gcl_core.ops.kpconv import Influences, KPConv, convolve
from gcl_core.ops.neighbor_max import neighbor_max
from gcl_core.ops.quarter_turns import QuarterTurnKPConv, QuarterTurnLinear, QuarterTurnNorm
from gcl_core.ops.repeatable import linear
from gcl_core.ops.sparse_conv import scale_and_shift

BN_MOMENTUM = 0.02  # of the public code
SLOPE = 0.1  # of the leaky ReLU; paper, figure "Network structures for GCL"
BOTTLENECK = 4  # a residual block convolves a quarter of its channels
Folded = tuple[torch.Tensor, torch.Tensor]  # weight (..., c_out) and bias (c_out)


def leaky(x: Float[torch.Tensor, 'n c']) -> Float[torch.Tensor, 'n c']:
    """Leaky ReLU."""
    return nn.functional.leaky_relu(x, SLOPE)


def norm_of(channels: int, *, quarter_turns: bool) -> nn.BatchNorm1d:
    """Batch norm, shared by the four blocks of features that know quarter turns."""
    kind = QuarterTurnNorm if quarter_turns else nn.BatchNorm1d
    return kind(channels, momentum=BN_MOMENTUM)


def fold(
    weight: Float[torch.Tensor, '... c_out'], norm: nn.BatchNorm1d, dtype: torch.dtype
) -> Folded:
    """Weight and bias of the one product that a product with a norm behind it is."""
    scale, bias = scale_and_shift(norm)
    blocks = weight.shape[-1] // len(scale)  # that share a norm
    scale, bias = scale.repeat(blocks), bias.repeat(blocks)
    return (weight.detach() * scale).to(dtype), bias.to(dtype)


class Unary(Folding[Folded]):
    """Linear layer point by point, batch norm."""

    def __init__(
        self, in_channels: int, out_channels: int, *, quarter_turns: bool = False
    ) -> None:
        super().__init__()
        self.norm = norm_of(out_channels, quarter_turns=quarter_turns)
        self.linear: nn.Linear | QuarterTurnLinear
        if quarter_turns:
            self.linear = QuarterTurnLinear(in_channels, out_channels, bias=False)
        else:
            self.linear = nn.Linear(in_channels, out_channels, bias=False)

    @property
    def weight(self) -> Float[torch.Tensor, 'c_in c_out']:
        """What a row is multiplied by."""
        weight: torch.Tensor = self.linear.weight
        return weight if isinstance(self.linear, QuarterTurnLinear) else weight.t()

    def forward(self, x: Float[torch.Tensor, 'n c_in']) -> Float[torch.Tensor, 'n c_out']:
        """Compute in the dtype of `x`."""
        weight = self.weight
        if folded := self.folded(x.dtype, lambda: fold(weight, self.norm, x.dtype)):
            return linear(x, *folded)
        out: torch.Tensor = self.norm(x @ weight.to(x.dtype))
        return out


class ConvNorm(Folding[Folded]):
    """KPConv, batch norm, leaky ReLU: the paper's "simple" block."""

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        kernel: int,
        *,
        quarter_turns: bool = False,
        lifts: bool = False,
    ) -> None:
        super().__init__()
        self.conv: KPConv | QuarterTurnKPConv
        if quarter_turns:
            self.conv = QuarterTurnKPConv(in_channels, out_channels, kernel, lifts=lifts)
        else:
            self.conv = KPConv(in_channels, out_channels, kernel)
        self.norm = norm_of(out_channels, quarter_turns=quarter_turns)

    def forward(
        self, x: Float[torch.Tensor, 'n c_in'], felt: Influences
    ) -> Float[torch.Tensor, 'm c_out']:
        """Convolve from the points of `x` to the outputs of `felt`."""
        if folded := self.folded(x.dtype, lambda: fold(self.conv.weight, self.norm, x.dtype)):
            return leaky(convolve(x, folded[0], felt) + folded[1])
        return leaky(self.norm(self.conv(x, felt)))


class ResidualBlock(nn.Module):
    """1x1, KPConv on a quarter of the channels, 1x1, plus a shortcut: the paper's "resnetb".

    With a table of neighbours it goes down a level and the shortcut takes their maximum
    ("resnetb strided").
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel: int, *, quarter_turns: bool = False
    ) -> None:
        super().__init__()
        narrow, turns = max(1, out_channels // BOTTLENECK), {'quarter_turns': quarter_turns}
        self.reduce = Unary(in_channels, narrow, **turns)
        self.conv = ConvNorm(narrow, narrow, kernel, **turns)
        self.expand = Unary(narrow, out_channels, **turns)
        same = in_channels == out_channels
        self.shortcut = nn.Identity() if same else Unary(in_channels, out_channels, **turns)

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
