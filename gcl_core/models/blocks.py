"""Building blocks of the sparse Res-UNet (Choy et al., FCGF, ICCV 2019)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import nn

from gcl_core.models.folding import Folding
from gcl_core.ops.kernel_map import CUBE_3, KernelMap, KernelShape
from gcl_core.ops.quarter_turns import QuarterTurnConv, QuarterTurnNorm
from gcl_core.ops.repeatable import linear
from gcl_core.ops.sparse_conv import FoldedConv, SparseConv

BN_MOMENTUM = 0.05  # of the public code, for both FCGF and GCL+Conv


class ConvNorm(Folding[FoldedConv]):
    """Sparse convolution, batch norm, an optional residual, ReLU.

    Args:
        in_channels, out_channels: of the convolution.
        shape: its kernel.
        quarter_turns: whether its features are in four blocks, see `ops.quarter_turns`.
        lifts: whether only its output is.
    """

    def __init__(
        self,
        in_channels: int,
        out_channels: int,
        shape: KernelShape = CUBE_3,
        *,
        quarter_turns: bool = False,
        lifts: bool = False,
    ) -> None:
        super().__init__()
        self.conv: SparseConv | QuarterTurnConv
        self.norm: nn.BatchNorm1d
        if quarter_turns:
            self.conv = QuarterTurnConv(in_channels, out_channels, shape, lifts=lifts)
            self.norm = QuarterTurnNorm(out_channels, momentum=BN_MOMENTUM)
        else:
            self.conv = SparseConv(in_channels, out_channels, shape)
            self.norm = nn.BatchNorm1d(out_channels, momentum=BN_MOMENTUM)

    def forward(
        self,
        x: Float[torch.Tensor, 'n_in c_in'],
        kmap: KernelMap,
        residual: Float[torch.Tensor, 'n_out c_out'] | None = None,
    ) -> Float[torch.Tensor, 'n_out c_out']:
        """Convolve over `kmap`, normalise, add the residual, ReLU."""
        folded = self.folded(x.dtype, lambda: FoldedConv.fold(self.conv.weight, self.norm, x))
        if folded is not None:
            return folded(x, kmap, residual)
        out = self.norm(self.conv(x, kmap))
        return torch.relu(out if residual is None else out + residual)


class ResidualBlock(nn.Module):
    """conv-BN-ReLU-conv-BN, plus the identity, ReLU."""

    def __init__(
        self, channels: int, shape: KernelShape = CUBE_3, *, quarter_turns: bool = False
    ) -> None:
        super().__init__()
        self.first = ConvNorm(channels, channels, shape, quarter_turns=quarter_turns)
        self.second = ConvNorm(channels, channels, shape, quarter_turns=quarter_turns)

    def forward(
        self, x: Float[torch.Tensor, 'n c'], kmap: KernelMap
    ) -> Float[torch.Tensor, 'n c']:
        """Keep voxels and channels."""
        out: torch.Tensor = self.second(self.first(x, kmap), kmap, x)
        return out


class Linear(nn.Linear):
    """A product whose bits, without a gradient, do not depend on the number of threads."""

    def forward(self, x: Float[torch.Tensor, 'n c_in']) -> Float[torch.Tensor, 'n c_out']:
        """Multiply every row."""
        if torch.is_grad_enabled():
            return super().forward(x)
        return linear(x, self.weight.t(), self.bias)
