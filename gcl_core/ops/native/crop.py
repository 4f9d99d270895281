"""The compiled search for points that can meet as a function of arrays."""

from __future__ import annotations

import ctypes

import numpy as np
import torch
from jaxtyping import Bool, Float

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import at


def near(
    points: Float[np.ndarray, 'n 3'],
    others: Float[np.ndarray, 'm 3'],
    T_points_others: Float[np.ndarray, 'h 4 4'],
    reach: float,
) -> Bool[np.ndarray, ' m'] | None:
    """Mark the others that any transform brings near, see `estimation/crop.py`; None: numpy does.

    Args:
        points: of a scan, at least one, metres.
        others: of another scan, metres.
        T_points_others: at least one.
        reach: metres.
    """
    if points.dtype != np.float32 or others.dtype != np.float32:
        return None
    lib = library()
    if lib is None:
        return None
    upper = (T_points_others[:, :3] / reach).astype(np.float32)
    there, here, rows = (
        torch.from_numpy(np.ascontiguousarray(array)) for array in (points, others, upper)
    )
    found = torch.empty(len(here), dtype=torch.uint8)
    lib.gcl_near(
        *(at(there), ctypes.c_int64(len(there)), ctypes.c_float(reach)),
        *(at(here), ctypes.c_int64(len(here)), at(rows), ctypes.c_int64(len(rows)), at(found)),
    )
    return np.asarray(found.numpy().view(bool))
