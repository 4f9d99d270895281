"""The compiled checks of transforms as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float32, Int32, UInt8

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at


def check_counts(
    T: Float32[torch.Tensor, 'h 4 4'],
    points: tuple[Float32[torch.Tensor, 'n 3'], Float32[torch.Tensor, 'm 3']],
    ranges: tuple[Float32[torch.Tensor, 'rows columns'], Float32[torch.Tensor, 'rows columns']],
    slopes: tuple[Float32[torch.Tensor, ' eighth'], Float32[torch.Tensor, ' borders']],
    solid: tuple[UInt8[torch.Tensor, ' quarter'], Float32[torch.Tensor, ' 7']],
    ground: tuple[Float32[torch.Tensor, ' columns'], Float32[torch.Tensor, ' 7']],
    tolerance: float,
) -> Int32[torch.Tensor, 'h 6'] | None:
    """Count points, see `_counted` in `gcl_core.estimation.verify`; None: torch has to do it.

    Args:
        T: transforms of the scan that is moved.
        points: its solid points and those of the ground, metres.
        ranges: shortest and longest around each direction of the other scan.
        slopes: borders of their columns and rows, see `range_image`.
        solid: cells that it occupies, and their grid, see `occupancy`, `grid_numbers`.
        ground: heights of its ground, and their grid.
        tolerance: misalignment that is no conflict, metres.
    """
    lib = library() if all(p.dtype == torch.float32 for p in (T, *points)) else None
    if lib is None:
        return None
    upper = T[:, :3].contiguous()
    counts = torch.empty(len(T), 6, dtype=torch.int32)
    near, far = (image.contiguous() for image in ranges)
    moving = [p.contiguous() for p in points]
    lib.gcl_check(
        *(at(upper), ctypes.c_int64(len(T))),
        *(x for p in moving for x in (at(p), ctypes.c_int64(len(p)))),
        *(at(near), at(far)),
        *(at(slopes[0]), ctypes.c_int(near.shape[1]), at(slopes[1]), ctypes.c_int(near.shape[0])),
        *(at(solid[0]), at(solid[1]), at(ground[0]), at(ground[1])),
        *(ctypes.c_double(tolerance), at(counts), ctypes.c_int(torch.get_num_threads())),
    )
    return counts
