"""The compiled scores of transforms as a function of tensors."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float32

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at

LANES = 16  # correspondences that the widest instruction takes at a time


def support_scores(
    T: Float32[torch.Tensor, 'h 4 4'], table: Float32[torch.Tensor, '7 n'], limit: float
) -> Float32[torch.Tensor, ' h'] | None:
    """Sum of the inliers' weights, see `gcl_core.estimation.support`; None: torch has to do it.

    Args:
        T: transforms.
        table: source x y z, target x y z, weight; `n` is a multiple of `LANES`.
        limit: on squared residuals.
    """
    lib = library() if table.device.type == 'cpu' else None
    if lib is None:
        return None
    rows, scores = T[:, :3].contiguous(), torch.empty(len(T))
    lib.gcl_support(
        *(at(rows), ctypes.c_int64(len(T)), at(table), ctypes.c_int64(table.shape[1])),
        *(ctypes.c_float(limit), at(scores), ctypes.c_int(torch.get_num_threads())),
    )
    return scores
