"""The compiled range image as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float32

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at


def range_image(
    points: Float32[torch.Tensor, 'n 3'],
    column_slopes: Float32[torch.Tensor, ' eighth'],
    row_slopes: Float32[torch.Tensor, ' borders'],
) -> tuple[Float32[torch.Tensor, 'rows columns'], Float32[torch.Tensor, 'rows columns']] | None:
    """Shortest and longest ranges, see `gcl_core.estimation.surface`; None: torch has to do it.

    Args:
        points: of a scan, metres.
        column_slopes: borders of the columns in an eighth of a turn, ascending, but the first.
        row_slopes: borders of the rows, ascending.
    """
    lib = library() if points.dtype == torch.float32 else None
    if lib is None:
        return None
    points = points.contiguous()
    near = torch.empty(len(row_slopes) - 1, 8 * len(column_slopes))
    far = torch.empty_like(near)
    lib.gcl_range_image(
        *(at(points), ctypes.c_int64(len(points))),
        *(at(column_slopes), ctypes.c_int(near.shape[1])),
        *(at(row_slopes), ctypes.c_int(near.shape[0])),
        *(at(near), at(far), ctypes.c_int(torch.get_num_threads())),
    )
    return near, far
