"""Rigid kernel point convolution (Thomas et al., KPConv, ICCV 2019).

    out_i = sum over neighbours j, kernel points k of  h(y_j - x_i, k) x_j W_k
    h(y, k) = max(0, 1 - |y - p_k| / extent)

The influences h depend on the points alone. They are one sparse matrix with a row for each pair
(i, k), shared by every convolution between the same points; a convolution is that matrix times the
features, then times W. The gradient of the input is the same with the two sides swapped.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float, Int32, Int64
from torch import nn

from gcl_core.ops.native.kpconv import gathered, influence_entries, inverted
from gcl_core.ops.repeatable import fixed_product

CHUNK_VALUES = 1 << 20  # features gathered at a time: bounds memory, whatever the size of a batch
INFLUENCE_VALUES = 1 << 18  # distances computed at a time: they stay in the second-level cache


@dataclass(frozen=True)
class Influences:
    """How much each input point counts at each kernel point of each output point, h above.

    Attributes:
        start: entries of output i and kernel point k are start[i * kernel + k] up to the next.
        column: input row of each entry.
        value: influence in ]0, 1].
        kernel: number of kernel points.
        num_inputs: number of input points.
    """

    start: Int64[torch.Tensor, ' r+1']
    column: Int32[torch.Tensor, ' e']
    value: Float[torch.Tensor, ' e']
    kernel: int
    num_inputs: int

    @property
    def num_outputs(self) -> int:
        """Number of output points."""
        return (len(self.start) - 1) // self.kernel

    @cached_property
    def inverse(self) -> Influences:
        """The same influences from the inputs' side: what the backward pass gathers by."""
        found = inverted(self.start, self.column, self.value, self.kernel, self.num_inputs)
        return Influences(*(found or self._by_sorting()), self.kernel, self.num_outputs)

    def _by_sorting(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        row = torch.repeat_interleave(self.start.diff())
        output, kernel_point = row // self.kernel, row % self.kernel
        own = self.column.long() * self.kernel + kernel_point
        order = torch.argsort(own, stable=True)
        sizes = torch.bincount(own, minlength=self.num_inputs * self.kernel)
        start = torch.cat([sizes.new_zeros(1), sizes.cumsum(0)])
        return start, output[order].int(), self.value[order]

    def matrix(self, start: Int64[torch.Tensor, ' r+1']) -> torch.Tensor:
        """The rows that this part of `start` is of, sparse."""
        entries, shape = slice(int(start[0]), int(start[-1])), (len(start) - 1, self.num_inputs)
        column, value, start = self.column[entries], self.value[entries], (start - start[0]).int()
        with warnings.catch_warnings():
            warnings.filterwarnings('ignore', message='Sparse CSR tensor support is in beta')
            return torch.sparse_csr_tensor(start, column, value, shape, check_invariants=False)


def influences(
    outputs: Float[torch.Tensor, 'm 3'],
    inputs: Float[torch.Tensor, 'n 3'],
    neighbors: Int32[torch.Tensor, 'm k'],
    kernel: Float[torch.Tensor, 'p 3'],
    extent: float,
) -> Influences:
    """Linear influences of neighbours on kernel points.

    Args:
        outputs: where the kernel is laid, metres.
        inputs: where the features are, metres.
        neighbors: rows of `inputs` around each output, `len(inputs)` where there is none.
        kernel: kernel points relative to an output, metres.
        extent: distance at which the influence ends, metres.
    """
    found = influence_entries(outputs, inputs, neighbors, kernel, extent)
    found = found or _by_torch(outputs, inputs, neighbors, kernel, extent)
    return Influences(*found, kernel=len(kernel), num_inputs=len(inputs))


def _by_torch(
    outputs: torch.Tensor,
    inputs: torch.Tensor,
    neighbors: torch.Tensor,
    kernel: torch.Tensor,
    extent: float,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    width, count, missing = neighbors.shape[1], len(kernel), len(inputs)
    # |y - p|^2 = (-2 p, 1) . (y, |y|^2) + |p|^2, in units of the extent.
    kernel = kernel.to(outputs) / extent
    left = torch.cat([-2 * kernel, torch.ones_like(kernel[:, :1])], 1)
    reach = 1 - kernel.square().sum(1, keepdim=True)
    padded = torch.cat([inputs, inputs.new_zeros(1, 3)])  # what is missing reads the last
    size = max(1, INFLUENCE_VALUES // max(1, width * count))
    sizes, columns, values = [], [], []
    for first in range(0, len(outputs), size):
        nearby = neighbors[first : first + size]
        table = nearby.long()
        offset = padded[table] - outputs[first : first + size, None]
        offset /= extent
        far = torch.where(table < missing, offset.square().sum(2), torch.inf)
        right = torch.cat([offset, far.unsqueeze(2)], 2).transpose(1, 2)
        squared = left.expand(len(table), -1, -1) @ right  # (rows, p, k)
        entry = (squared < reach).ravel().nonzero().squeeze(1)
        row = entry // width
        distance = (squared.ravel()[entry] - (reach - 1).ravel()[row % count]).clamp(min=0).sqrt()
        sizes.append(torch.bincount(row, minlength=len(table) * count))
        columns.append(nearby.ravel()[row // count * width + entry % width])
        values.append(1 - distance)
    start = torch.cat([torch.zeros(1, dtype=torch.long, device=outputs.device), *sizes]).cumsum(0)
    column = torch.cat([neighbors[:0, 0], *columns])
    return start, column, torch.cat([outputs[:0, 0], *values])


def gather(
    x: Float[torch.Tensor, 'n c'], felt: Influences
) -> Iterator[tuple[slice, Float[torch.Tensor, 'r pc']]]:
    """Features summed at each kernel point, a chunk of output rows at a time."""
    size, wide = max(1, CHUNK_VALUES // (felt.kernel * max(1, x.shape[1]))), None
    for first in range(0, felt.num_outputs, size):
        rows = slice(first, min(first + size, felt.num_outputs))
        start = felt.start[rows.start * felt.kernel : rows.stop * felt.kernel + 1]
        summed = gathered(x, start, felt.column, felt.value)
        if summed is None:
            if wide is None:
                wide = x.to(torch.promote_types(x.dtype, torch.float32))
            summed = (felt.matrix(start).to(wide.dtype) @ wide).to(x.dtype)
        yield rows, summed.view(rows.stop - rows.start, -1)


def convolve(
    x: Float[torch.Tensor, 'n c_in'], weight: Float[torch.Tensor, 'p c_in c_out'], felt: Influences
) -> Float[torch.Tensor, 'm c_out']:
    """Convolve without a gradient."""
    flat = weight.to(x.dtype).reshape(-1, weight.shape[2])
    out = x.new_empty(felt.num_outputs, weight.shape[2])
    product = fixed_product(flat)
    for rows, summed in gather(x, felt):
        out[rows] = product(summed)
    return out


class _KPConvFunction(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, weight: torch.Tensor, felt: Influences) -> torch.Tensor:
        ctx.save_for_backward(x, weight)
        ctx.felt = felt
        return convolve(x, weight, felt)

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        x, weight = ctx.saved_tensors
        grad_x = grad_weight = None
        if ctx.needs_input_grad[0]:
            grad_x = convolve(grad, weight.transpose(1, 2), ctx.felt.inverse)
        if ctx.needs_input_grad[1]:
            total = torch.zeros_like(weight).view(-1, weight.shape[2])
            for rows, summed in gather(x, ctx.felt):
                total += summed.t() @ grad[rows]
            grad_weight = total.view_as(weight)
        return grad_x, grad_weight, None


def kpconv(
    x: Float[torch.Tensor, 'n c_in'], weight: Float[torch.Tensor, 'p c_in c_out'], felt: Influences
) -> Float[torch.Tensor, 'm c_out']:
    """Convolve; computes in the dtype of `x`."""
    out: torch.Tensor = _KPConvFunction.apply(x, weight, felt)
    return out


class KPConv(nn.Module):
    """Kernel point convolution without bias, sum aggregation; the influences are handed in."""

    def __init__(self, in_channels: int, out_channels: int, kernel: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(kernel, in_channels, out_channels))
        # A size for the norm behind it to start from; what arrives depends on the density.
        if not self.weight.is_meta:  # as in `SparseConv`
            nn.init.normal_(self.weight, std=math.sqrt(2.0 / (kernel * in_channels)))

    def forward(
        self, x: Float[torch.Tensor, 'n c_in'], felt: Influences
    ) -> Float[torch.Tensor, 'm c_out']:
        """Convolve; computes in the dtype of `x`."""
        return kpconv(x, self.weight, felt)
