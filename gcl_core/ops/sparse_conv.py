"""Sparse convolution: gather the existing neighbours, multiply once.

Output rows are taken in chunks small enough for the gathered block to stay in cache. The gradient
of the input is the same gather with the inverse map, that of the weight a product per chunk;
nothing is scattered, so forward and backward are deterministic.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from jaxtyping import Float, Int32
from torch import nn

from gcl_core.ops.kernel_map import KernelMap

CHUNK_ELEMENTS = 2048 * 27 * 64  # of the gathered block: fastest of 2^18..2^24 at 32-256 channels


def _with_zero_row(x: Float[torch.Tensor, 'n c']) -> Float[torch.Tensor, 'n+1 c']:
    """Append the row of zeros that missing neighbours point to."""
    return torch.cat([x, x.new_zeros(1, x.shape[1])])


def _chunks(rows: int, row_elements: int) -> list[tuple[int, int]]:
    step = max(256, CHUNK_ELEMENTS // max(row_elements, 1))
    return [(start, min(start + step, rows)) for start in range(0, rows, step)]


def gather_matmul(
    x: Float[torch.Tensor, 'n_in c_in'],
    neighbors: Int32[torch.Tensor, 'n_out k'],
    weight: Float[torch.Tensor, 'k c_in c_out'],
) -> Float[torch.Tensor, 'n_out c_out']:
    """Sum `x[neighbors[:, j]] @ weight[j]` over the kernel offsets j."""
    rows, kernel = neighbors.shape
    width = kernel * x.shape[1]
    flat_weight = weight.reshape(width, -1)
    out = x.new_empty(rows, flat_weight.shape[1])
    padded = _with_zero_row(x)
    index = neighbors.reshape(-1)
    chunks = _chunks(rows, width)
    buffer = x.new_empty((chunks[0][1] * kernel if chunks else 0, x.shape[1]))
    for start, end in chunks:
        gathered = buffer[: (end - start) * kernel]
        torch.index_select(padded, 0, index[start * kernel : end * kernel], out=gathered)
        torch.mm(gathered.view(end - start, width), flat_weight, out=out[start:end])
    return out


def gather_weight_grad(
    x: Float[torch.Tensor, 'n_in c_in'],
    neighbors: Int32[torch.Tensor, 'n_out k'],
    grad: Float[torch.Tensor, 'n_out c_out'],
) -> Float[torch.Tensor, 'k c_in c_out']:
    """Gradient of `gather_matmul` with respect to its weight, summed over chunks in float32."""
    rows, kernel = neighbors.shape
    width = kernel * x.shape[1]
    total = torch.zeros(width, grad.shape[1])
    padded = _with_zero_row(x)
    index = neighbors.reshape(-1)
    for start, end in _chunks(rows, width):
        gathered = padded.index_select(0, index[start * kernel : end * kernel])
        total += gathered.view(end - start, width).t() @ grad[start:end]
    return total.view(kernel, x.shape[1], -1)


class _SparseConvFunction(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, weight: torch.Tensor, kmap: KernelMap) -> torch.Tensor:
        ctx.save_for_backward(x, weight)
        ctx.kmap = kmap
        return gather_matmul(x, kmap.neighbors, weight.to(x.dtype))

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        x, weight = ctx.saved_tensors
        grad = grad.contiguous()
        grad_x = grad_weight = None
        if ctx.needs_input_grad[0]:
            transposed = weight.to(x.dtype).transpose(1, 2).contiguous()
            grad_x = gather_matmul(grad, ctx.kmap.inverse, transposed)
        if ctx.needs_input_grad[1]:
            grad_weight = gather_weight_grad(x, ctx.kmap.neighbors, grad).to(weight.dtype)
        return grad_x, grad_weight, None


def sparse_conv(
    x: Float[torch.Tensor, 'n_in c_in'],
    weight: Float[torch.Tensor, 'k c_in c_out'],
    kmap: KernelMap,
) -> Float[torch.Tensor, 'n_out c_out']:
    """Convolve sparse features; computes in the dtype of `x` (float32 or bfloat16).

    Equal to `torch.nn.functional.conv3d` on the dense grid, read at the output voxels
    (Choy et al., Minkowski networks, CVPR 2019, eq. 3).
    """
    out: torch.Tensor = _SparseConvFunction.apply(x, weight, kmap)
    return out


class SparseConv(nn.Module):
    """Sparse convolution without bias; stride and transposition are the map's business."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int = 3) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(kernel**3, in_channels, out_channels))
        # He initialisation for the neighbours that exist: about 8 of 27 (measured on HDL-64E).
        nn.init.normal_(self.weight, std=math.sqrt(2.0 / (0.3 * kernel**3 * in_channels)))

    def forward(
        self, x: Float[torch.Tensor, 'n_in c_in'], kmap: KernelMap
    ) -> Float[torch.Tensor, 'n_out c_out']:
        """Convolve over `kmap`."""
        return sparse_conv(x, self.weight, kmap)
