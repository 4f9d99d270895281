"""Building blocks of the sparse Res-UNet (Choy et al., FCGF, ICCV 2019)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import nn

from gcl_core.ops.kernel_map import KernelMap
from gcl_core.ops.sparse_conv import FoldedConv, SparseConv

BN_MOMENTUM = 0.05  # of the public code, for both FCGF and GCL+Conv


class ConvNorm(nn.Module):
    """Sparse convolution, batch norm, an optional residual, ReLU."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int = 3) -> None:
        super().__init__()
        self.conv = SparseConv(in_channels, out_channels, kernel)
        self.norm = nn.BatchNorm1d(out_channels, momentum=BN_MOMENTUM)
        self._folded: dict[torch.dtype, FoldedConv] = {}

    def train(self, mode: bool = True) -> ConvNorm:
        """Switch mode; what was folded for inference is forgotten, the weights may change."""
        self._folded.clear()
        return super().train(mode)

    def forward(
        self,
        x: Float[torch.Tensor, 'n_in c_in'],
        kmap: KernelMap,
        residual: Float[torch.Tensor, 'n_out c_out'] | None = None,
    ) -> Float[torch.Tensor, 'n_out c_out']:
        """Convolve over `kmap`, normalise, add the residual, ReLU."""
        if not self.training and not torch.is_grad_enabled():
            if x.dtype not in self._folded:
                self._folded[x.dtype] = FoldedConv.fold(self.conv, self.norm, x)
            return self._folded[x.dtype](x, kmap, residual)
        out = self.norm(self.conv(x, kmap))
        return torch.relu(out if residual is None else out + residual)


class ResidualBlock(nn.Module):
    """conv3-BN-ReLU-conv3-BN, plus the identity, ReLU."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = ConvNorm(channels, channels)
        self.second = ConvNorm(channels, channels)

    def forward(
        self, x: Float[torch.Tensor, 'n c'], kmap: KernelMap
    ) -> Float[torch.Tensor, 'n c']:
        """Keep voxels and channels."""
        out: torch.Tensor = self.second(self.first(x, kmap), kmap, x)
        return out
