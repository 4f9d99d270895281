"""The compiled octree coder as functions of arrays, see `gcl_core.compact.octree`."""

from __future__ import annotations

import ctypes

import numpy as np
from jaxtyping import Int64, UInt16

from gcl_core.ops.native.build import library

BYTES_A_VOXEL = 4  # room that is enough for all but noise
LONG, INT = ctypes.c_int64, ctypes.c_int


def encode(
    keys: Int64[np.ndarray, ' n'], depth: int, priors: UInt16[np.ndarray, ' contexts']
) -> bytes | None:
    """Bytes of the voxels; None if Python has to do it."""
    function = _function('gcl_octree_encode')
    if function is None:
        return None
    keys = np.ascontiguousarray(keys, np.int64)
    capacity = 1024 + BYTES_A_VOXEL * len(keys)
    while True:
        out, probabilities = np.empty(capacity, np.uint8), priors.copy()
        size = function(
            *(_at(keys), LONG(len(keys)), INT(depth)),
            *(_at(probabilities), _at(out), LONG(capacity)),
        )
        if size >= 0:
            return out[:size].tobytes()
        capacity *= 2


def decode(
    data: bytes, depth: int, count: int, priors: UInt16[np.ndarray, ' contexts']
) -> Int64[np.ndarray, ' n'] | None:
    """Voxels of the bytes, none where they are not `count`; None if Python has to do it."""
    function = _function('gcl_octree_decode')
    if function is None:
        return None
    keys, probabilities = np.empty(count, np.int64), priors.copy()
    found = function(
        *(data, LONG(len(data)), INT(depth)), *(_at(probabilities), _at(keys), LONG(count))
    )
    return keys if found == count else keys[:0]


def _function(name: str) -> ctypes._NamedFuncPointer | None:
    lib = library()
    if lib is None:
        return None
    function = getattr(lib, name)
    function.restype = LONG
    return function


def _at(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
