"""The compiled radius search as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float32, Int32

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at

REACH = 1 << 20  # cells that the kernel can count to on either side of the origin


def radius_search(
    queries: Float32[torch.Tensor, 'm 3'],
    support: Float32[torch.Tensor, 'n 3'],
    *,
    radius: float,
    limit: int,
) -> tuple[Int32[torch.Tensor, 'm k'], Int32[torch.Tensor, ' m']] | None:
    """Neighbour table and counts, see `gcl_core.ops.neighbors`; None if another has to do it."""
    lib = library() if queries.dtype == support.dtype == torch.float32 else None
    if lib is None or max(_farthest(queries), _farthest(support)) >= (REACH - 2) * radius:
        return None
    queries, support = queries.contiguous(), support.contiguous()
    rows = torch.empty(len(queries), limit, dtype=torch.int32)
    counts = torch.empty(len(queries), dtype=torch.int32)
    lib.gcl_radius(
        *(at(support), ctypes.c_int64(len(support))),
        *(at(queries), ctypes.c_int64(len(queries))),
        *(ctypes.c_double(radius), ctypes.c_int64(limit)),
        *(at(rows), at(counts), ctypes.c_int(torch.get_num_threads())),
    )
    return rows, counts


def _farthest(points: torch.Tensor) -> float:
    return float(points.abs().max()) if len(points) else 0.0
