"""The compiled grids around a sensor as functions of tensors."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence

import torch
from jaxtyping import Float32, UInt8

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at


def grid_numbers(
    low: Sequence[float], size: float, shape: Sequence[int]
) -> Float32[torch.Tensor, ' 7']:
    """Where the cells beside the margin begin, their edge, and how many there are on each axis."""
    return torch.tensor([*low, size, *shape])


def occupancy(
    points: Float32[torch.Tensor, 'n 3'], grid: Float32[torch.Tensor, ' 7']
) -> UInt8[torch.Tensor, ' quarter'] | None:
    """Cells with points and beside them, see `gcl_core.estimation.surface`; None: torch's turn."""
    lib = library() if points.dtype == torch.float32 else None
    if lib is None:
        return None
    points = points.contiguous()
    cells = math.prod(map(int, grid[4:].tolist()))
    occupied = torch.zeros(-(-cells // 4), dtype=torch.uint8)
    lib.gcl_occupancy(at(points), ctypes.c_int64(len(points)), at(grid), at(occupied))
    return occupied


def mean_heights(
    points: Float32[torch.Tensor, 'n 3'], grid: Float32[torch.Tensor, ' 7']
) -> Float32[torch.Tensor, ' columns'] | None:
    """Mean z of the points of each column of cells; nan without any; None: torch has to do it."""
    lib = library() if points.dtype == torch.float32 else None
    if lib is None:
        return None
    points = points.contiguous()
    height = torch.empty(int(grid[4] * grid[5]))
    lib.gcl_mean_heights(at(points), ctypes.c_int64(len(points)), at(grid), at(height))
    return height
