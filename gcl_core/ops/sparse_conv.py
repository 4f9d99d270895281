"""Sparse convolution: multiply the pairs of voxels that exist, offset by offset.

The torch functions here are the definition, on any device and in any dtype. On a CPU, compiled
kernels (native/sparse_conv.cpp) do the same in float32 and bfloat16 without a copy of the
gathered rows. The gradient of the input is the same convolution over the inverse map, that of the
weight a product per offset; forward and backward are deterministic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int32, Int64
from torch import nn

from gcl_core.ops.kernel_map import KernelMap, KernelShape
from gcl_core.ops.native.kernels import PackedWeight, kernels_for

FILL = 0.3  # share of neighbours that exist, for He initialisation: 8 of 27 (measured on HDL-64E)


def _pairs(
    neighbors: Int32[torch.Tensor, ' n_out'], num_inputs: int
) -> tuple[Int64[torch.Tensor, ' p'], Int64[torch.Tensor, ' p']]:
    """Input and output rows that one kernel offset connects."""
    out = (neighbors < num_inputs).nonzero().squeeze(1)
    return neighbors[out].long(), out


def gather_matmul(
    x: Float[torch.Tensor, 'n_in c_in'],
    neighbors: Int32[torch.Tensor, 'k n_out'],
    weight: Float[torch.Tensor, 'k c_in c_out'],
) -> Float[torch.Tensor, 'n_out c_out']:
    """Sum `x[neighbors[j]] @ weight[j]` over the kernel offsets j, in float32 or better."""
    wide = torch.promote_types(x.dtype, torch.float32)
    total = x.new_zeros(neighbors.shape[1], weight.shape[2], dtype=wide)
    for offset in range(len(neighbors)):
        source, out = _pairs(neighbors[offset], len(x))
        total[out] += x[source] @ weight[offset].to(x.dtype)  # no row comes twice in `out`
    return total.to(x.dtype)


def gather_weight_grad(
    x: Float[torch.Tensor, 'n_in c_in'],
    neighbors: Int32[torch.Tensor, 'k n_out'],
    grad: Float[torch.Tensor, 'n_out c_out'],
) -> Float[torch.Tensor, 'k c_in c_out']:
    """Gradient of `gather_matmul` with respect to its weight."""
    products = []
    for row in neighbors:
        source, out = _pairs(row, len(x))
        products.append(x[source].t() @ grad[out])
    return torch.stack(products)


class _SparseConvFunction(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, weight: torch.Tensor, kmap: KernelMap) -> torch.Tensor:
        ctx.save_for_backward(x, weight)
        ctx.kmap = kmap
        kernels = kernels_for(x)
        if kernels:
            return kernels.convolve(x, kmap.neighbors, kernels.pack(weight))
        return gather_matmul(x, kmap.neighbors, weight)

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        x, weight = ctx.saved_tensors
        kmap: KernelMap = ctx.kmap
        kernels = kernels_for(x)
        grad_x = grad_weight = None
        if ctx.needs_input_grad[0] and kernels:
            grad_x = kernels.convolve(grad, kmap.inverse, kernels.pack(weight, transposed=True))
        elif ctx.needs_input_grad[0]:
            grad_x = gather_matmul(grad, kmap.inverse, weight.transpose(1, 2))
        if ctx.needs_input_grad[1]:
            of_weight = kernels.weight_grad if kernels else gather_weight_grad
            grad_weight = of_weight(x, kmap.neighbors, grad).to(weight.dtype)
        return grad_x, grad_weight, None


def sparse_conv(
    x: Float[torch.Tensor, 'n_in c_in'],
    weight: Float[torch.Tensor, 'k c_in c_out'],
    kmap: KernelMap,
) -> Float[torch.Tensor, 'n_out c_out']:
    """Convolve sparse features; computes in the dtype of `x`.

    Equal to `torch.nn.functional.conv3d` on the dense grid, read at the output voxels
    (Choy et al., Minkowski networks, CVPR 2019, eq. 3).
    """
    out: torch.Tensor = _SparseConvFunction.apply(x, weight, kmap)
    return out


class SparseConv(nn.Module):
    """Sparse convolution without bias; stride and transposition are the map's business."""

    def __init__(self, in_channels: int, out_channels: int, shape: KernelShape) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(shape.offsets, in_channels, out_channels))
        std = math.sqrt(2.0 / (FILL * shape.offsets * in_channels))
        if not self.weight.is_meta:  # to draw nothing, torch would import its compiler: a second
            nn.init.normal_(self.weight, std=std)

    def forward(
        self, x: Float[torch.Tensor, 'n_in c_in'], kmap: KernelMap
    ) -> Float[torch.Tensor, 'n_out c_out']:
        """Convolve over `kmap`."""
        return sparse_conv(x, self.weight, kmap)


def scale_and_shift(
    norm: nn.BatchNorm1d,
) -> tuple[Float[torch.Tensor, ' c'], Float[torch.Tensor, ' c']]:
    """What a batch norm multiplies and adds in inference, for each of its own channels."""
    if norm.running_mean is None or norm.running_var is None:
        raise ValueError('a batch norm without running statistics cannot be folded')
    scale = (norm.weight * (norm.running_var + norm.eps).rsqrt()).detach()
    return scale, (norm.bias - norm.running_mean * scale).detach()


@dataclass(frozen=True)
class FoldedConv:
    """Convolution, batch norm, residual and ReLU in one pass, for inference.

    Attributes:
        weight: with the norm's scale folded in, float32.
        bias: what is left of the norm, float32.
        packed: the weight as the compiled kernels read it, where they are used.
    """

    weight: Float[torch.Tensor, 'k c_in c_out']
    bias: Float[torch.Tensor, ' c_out']
    packed: PackedWeight | None

    @classmethod
    def fold(
        cls, weight: Float[torch.Tensor, 'k c_in c_out'], norm: nn.BatchNorm1d, like: torch.Tensor
    ) -> FoldedConv:
        """Fold a convolution and the norm behind it, for features such as `like`.

        A norm of fewer channels than the convolution's is shared by blocks of them.
        """
        scale, bias = scale_and_shift(norm)
        blocks = weight.shape[2] // len(scale)
        scale, bias = scale.repeat(blocks), bias.repeat(blocks)
        weight = (weight * scale).detach()
        kernels = kernels_for(like)
        return cls(weight, bias, kernels.pack(weight) if kernels else None)

    def __call__(
        self,
        x: Float[torch.Tensor, 'n_in c_in'],
        kmap: KernelMap,
        residual: Float[torch.Tensor, 'n_out c_out'] | None = None,
    ) -> Float[torch.Tensor, 'n_out c_out']:
        """Return ReLU(convolution + bias + residual)."""
        kernels = kernels_for(x)
        if kernels and self.packed:
            return kernels.convolve(
                x, kmap.neighbors, self.packed, bias=self.bias, residual=residual, relu=True
            )
        out = gather_matmul(x, kmap.neighbors, self.weight) + self.bias.to(x.dtype)
        return torch.relu(out if residual is None else out + residual)
