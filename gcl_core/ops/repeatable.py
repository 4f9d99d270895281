"""Products and sums whose bits do not depend on the number of threads, on any processor.

A matrix product of a library, and a sum over all of a tensor, are cut up by the number of threads,
and rounded as they are cut. Here every number is computed by one thread in a fixed order: by a
compiled kernel, by steps that are each rounded exactly (+, -, *, /, square roots), or row by row.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float

from gcl_core.ops.native.kernels import kernels_for

ROW_PIECE = 1 << 10  # numbers of a row that are added up at a time


def moved(
    T: Float[torch.Tensor, 'h 4 4'], points: Float[torch.Tensor, 'n 3']
) -> Float[torch.Tensor, 'h 3 n']:
    """Points under each of some rigid transforms, axis by axis."""
    x, y, z = points.t().contiguous()
    rows = T[:, :3, :, None]
    out = rows[:, :, 0] * x
    out += rows[:, :, 1] * y
    out += rows[:, :, 2] * z
    out += rows[:, :, 3]
    return out


def row_sums(values: Float[torch.Tensor, 'h n']) -> Float[torch.Tensor, ' h']:
    """Sum of each row."""
    missing = -values.shape[1] % ROW_PIECE if values.shape[1] else ROW_PIECE
    pieces = torch.nn.functional.pad(values, (0, missing)).unflatten(1, (-1, ROW_PIECE))
    sums = pieces.sum(2)
    total = sums[:, 0].clone()
    for piece in sums.unbind(1)[1:]:
        total += piece
    return total


def gram(
    a: Float[torch.Tensor, 'n k'], b: Float[torch.Tensor, 'n m']
) -> Float[torch.Tensor, 'k m']:
    """Sum over the rows of the products of their numbers, `a.t() @ b`, in float32."""
    kernels = kernels_for(a)
    if kernels:
        return kernels.weight_grad(a, _rows(len(a)), b)[0]
    return torch.from_numpy(np.einsum('nk,nm->km', a.numpy(), b.numpy()))


def product(
    a: Float[torch.Tensor, 'n k'], b: Float[torch.Tensor, 'k m']
) -> Float[torch.Tensor, 'n m']:
    """Matrix product, `a @ b`."""
    kernels = kernels_for(a)
    if kernels:
        return kernels.convolve(a, _rows(len(a)), kernels.pack(b[None]))
    return torch.from_numpy(np.einsum('nk,km->nm', a.numpy(), b.numpy()))


def fixed_product(
    b: Float[torch.Tensor, 'k m'], bias: Float[torch.Tensor, ' m'] | None = None
) -> Callable[[Float[torch.Tensor, 'n k']], Float[torch.Tensor, 'n m']]:
    """Function that multiplies by `b` and adds a bias, without a gradient.

    In plain torch, and in bfloat16, it is the product of torch's libraries: a network needs its
    speed.
    """
    kernels = kernels_for(b) if b.dtype == torch.float32 else None
    if kernels:
        packed = kernels.pack(b[None])
        return lambda a: kernels.convolve(a, _rows(len(a)), packed, bias=bias)
    return lambda a: a @ b if bias is None else torch.addmm(bias, a, b)


def linear(
    a: Float[torch.Tensor, 'n k'],
    b: Float[torch.Tensor, 'k m'],
    bias: Float[torch.Tensor, ' m'] | None = None,
) -> Float[torch.Tensor, 'n m']:
    """Apply `fixed_product` once."""
    return fixed_product(b, bias)(a)


def _rows(count: int) -> torch.Tensor:
    """The map of a convolution that reads each row by itself."""
    return torch.arange(count, dtype=torch.int32)[None]
