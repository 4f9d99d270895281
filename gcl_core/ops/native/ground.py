"""The compiled height above the ground as a function of tensors, see `gcl_core.ops.ground`."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import INT, at

FLOAT, LONG = ctypes.c_float, ctypes.c_int64


def height_above(
    points: Float[torch.Tensor, 'n 3'],
    scan: Int64[torch.Tensor, ' n'],
    *,
    cell: float,
    ghosts: float,
    axis_bits: int,
    limit: int,
) -> Float[torch.Tensor, ' n'] | None:
    """Height over the lowest ground around each point, metres; None if torch has to do it."""
    lib = library() if points.device.type == 'cpu' and points.dtype == torch.float32 else None
    if lib is None:
        return None
    points, scan, height = points.contiguous(), scan.contiguous(), torch.empty(len(points))
    failed = lib.gcl_height(
        *(at(points), at(scan), LONG(len(points)), FLOAT(cell), FLOAT(ghosts)),
        *(INT(axis_bits), LONG(limit), at(height)),
    )
    return None if failed else height
