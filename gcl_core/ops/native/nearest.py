"""The compiled search in feature space as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import SUFFIX, at


def nearest_rows(
    source: Float[torch.Tensor, 'n d'], target: Float[torch.Tensor, 'm d']
) -> tuple[Float[torch.Tensor, ' n'], Int64[torch.Tensor, ' n'], Float[torch.Tensor, ' m']] | None:
    """Similarity and row of each one's nearest, see `matching/nearest.py`; None: torch does it.

    Both of one dtype, not empty.
    """
    suffix = SUFFIX.get(source.dtype)
    lib = library() if suffix and source.device.type == 'cpu' else None
    if lib is None:
        return None
    odd = source.shape[1] % 2  # two bfloat16 are read at a time
    source, target = (torch.nn.functional.pad(x, (0, odd)).contiguous() for x in (source, target))
    value, best = torch.empty(len(source)), torch.empty(len(target))
    column = torch.empty(len(source), dtype=torch.int32)
    getattr(lib, f'gcl_nearest_{suffix}')(
        *(at(source), ctypes.c_long(len(source)), at(target), ctypes.c_long(len(target))),
        *(ctypes.c_long(source.shape[1]), at(value), at(column), at(best)),
        ctypes.c_int(torch.get_num_threads()),
    )
    return value, column.long(), best
