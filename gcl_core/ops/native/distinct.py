"""The compiled choice of distinct transforms as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at


def distinct_rows(
    T: Float[torch.Tensor, 'h 4 4'],
    order: Int64[torch.Tensor, ' n'],
    limit: int,
    *,
    squared_distance: float,
    least_trace: float,
) -> list[int] | None:
    """Rows that differ from all before, see `gcl_core.estimation.hypothesis`; None: torch does it.

    Args:
        T: transforms; torch does those of float64.
        order: rows to look at.
        limit: most that are taken.
        squared_distance: of translations, beyond which transforms differ, square metres.
        least_trace: of a rotation between them, below which they differ.
    """
    lib = library() if T.dtype == torch.float32 else None
    if lib is None:
        return None
    T, order = T.contiguous(), order.contiguous()
    taken = torch.empty(min(limit, len(order)), dtype=torch.long)
    lib.gcl_distinct.restype = ctypes.c_int64
    count = lib.gcl_distinct(
        *(at(T), at(order), ctypes.c_int64(len(order)), ctypes.c_double(squared_distance)),
        *(ctypes.c_double(least_trace), ctypes.c_int64(len(taken)), at(taken)),
    )
    rows: list[int] = taken[:count].tolist()
    return rows
