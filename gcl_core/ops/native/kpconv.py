"""The compiled parts of KPConv as functions of tensors; each is None if torch has to do it."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float, Int32, Int64

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import SUFFIX, at


def influence_entries(
    outputs: Float[torch.Tensor, 'm 3'],
    inputs: Float[torch.Tensor, 'n 3'],
    neighbors: Int32[torch.Tensor, 'm k'],
    kernel: Float[torch.Tensor, 'p 3'],
    extent: float,
) -> (
    tuple[Int64[torch.Tensor, ' r+1'], Int32[torch.Tensor, ' e'], Float[torch.Tensor, ' e']] | None
):
    """Start, column and value of `gcl_core.ops.kpconv.Influences`."""
    plain = all(t.dtype == torch.float32 and not t.is_cuda for t in (outputs, inputs, kernel))
    lib = library() if plain else None
    if lib is None:
        return None
    outputs, inputs, neighbors = outputs.contiguous(), inputs.contiguous(), neighbors.contiguous()
    by_axis = kernel.t().contiguous()
    start = torch.zeros(len(outputs) * len(kernel) + 1, dtype=torch.long)
    column, value = torch.empty(0, dtype=torch.int32), torch.empty(0)
    for fill in (False, True):
        if fill:
            start = start.cumsum(0)
            column = torch.empty(int(start[-1]), dtype=torch.int32)
            value = torch.empty(int(start[-1]))
        lib.gcl_influences(
            *(at(outputs), at(inputs), ctypes.c_int64(len(inputs))),
            *(at(neighbors), *map(ctypes.c_int64, neighbors.shape)),
            *(at(by_axis), ctypes.c_int64(len(kernel)), ctypes.c_float(extent), at(start)),
            *(at(column) if fill else None, at(value) if fill else None),
            ctypes.c_int(torch.get_num_threads()),
        )
    return start, column, value


def gathered(
    x: Float[torch.Tensor, 'n c'],
    start: Int64[torch.Tensor, ' r+1'],
    column: Int32[torch.Tensor, ' e'],
    value: Float[torch.Tensor, ' e'],
) -> Float[torch.Tensor, 'r c'] | None:
    """Weighted sums of features: rows of a sparse matrix; `start` counts through all of it."""
    suffix = SUFFIX.get(x.dtype)
    plain = suffix and value.dtype == torch.float32 and not x.is_cuda
    lib = library() if plain else None
    if lib is None:
        return None
    x, start = x.contiguous(), start.contiguous()
    out = x.new_empty(len(start) - 1, x.shape[1])
    getattr(lib, f'gcl_gather_{suffix}')(
        *(at(x), ctypes.c_int64(x.shape[1]), at(start), ctypes.c_int64(len(out))),
        *(at(column), at(value), at(out), ctypes.c_int(torch.get_num_threads())),
    )
    return out


def inverted(
    start: Int64[torch.Tensor, ' r+1'],
    column: Int32[torch.Tensor, ' e'],
    value: Float[torch.Tensor, ' e'],
    kernel: int,
    num_inputs: int,
) -> (
    tuple[Int64[torch.Tensor, ' s+1'], Int32[torch.Tensor, ' e'], Float[torch.Tensor, ' e']] | None
):
    """Start, output and value of the influences from the inputs' side."""
    lib = library() if value.dtype == torch.float32 and not value.is_cuda else None
    if lib is None:
        return None
    num_outputs = (len(start) - 1) // kernel
    ends = torch.zeros(num_inputs * kernel + 1, dtype=torch.long)
    output, swapped = torch.empty_like(column), torch.empty_like(value)
    arguments = at(start), ctypes.c_int64(num_outputs), ctypes.c_int64(kernel), at(column)
    lib.gcl_invert(*arguments, None, at(ends[1:]), None, None)
    starts = ends.cumsum(0)
    moving = starts.clone()
    lib.gcl_invert(*arguments, at(value), at(moving), at(output), at(swapped))
    return starts, output, swapped


def neighbor_max_rows(
    x: Float[torch.Tensor, 'n c'], neighbors: Int32[torch.Tensor, 'm k']
) -> tuple[Float[torch.Tensor, 'm c'], Int32[torch.Tensor, 'm c']] | None:
    """Largest feature among the neighbours, and its row."""
    suffix = SUFFIX.get(x.dtype)
    lib = library() if suffix and not x.is_cuda else None
    if lib is None:
        return None
    x, neighbors = x.contiguous(), neighbors.contiguous()
    out = x.new_empty(len(neighbors), x.shape[1])
    winner = torch.empty(out.shape, dtype=torch.int32)
    getattr(lib, f'gcl_neighbor_max_{suffix}')(
        *(at(x), *map(ctypes.c_int64, x.shape)),
        *(at(neighbors), *map(ctypes.c_int64, neighbors.shape)),
        *(at(out), at(winner), ctypes.c_int(torch.get_num_threads())),
    )
    return out, winner
