"""The compiled choice of points spread in space as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float32, Int64

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at


def spread_rows(
    points: Float32[torch.Tensor, 'n 3'],
    order: Int64[torch.Tensor, ' n'],
    *,
    size: float,
    limit: int,
) -> Int64[torch.Tensor, ' limit'] | None:
    """Ascending rows of some points, see `gcl_core.matching.keypoints`; None: torch has to do it.

    Args:
        points: metres.
        order: in which they queue in their cells.
        size: edge of a cell, metres.
        limit: fewer than there are points.
    """
    lib = library() if points.dtype == torch.float32 and points.device.type == 'cpu' else None
    if lib is None:
        return None
    points, chosen = points.contiguous(), torch.zeros(len(points), dtype=torch.uint8)
    refused = lib.gcl_spread(
        *(at(points), at(order), ctypes.c_int64(len(points))),
        *(ctypes.c_float(size), ctypes.c_int64(limit), at(chosen)),
    )
    return None if refused else torch.nonzero(chosen).squeeze(1)
