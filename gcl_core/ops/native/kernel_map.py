"""The compiled searches for neighbours as functions of tensors, see `gcl_core.ops.kernel_map`."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Int32, Int64

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import INT, at

LONG = ctypes.c_int64


def search(
    keys: Int64[torch.Tensor, ' n'],
    centres: Int64[torch.Tensor, ' m'],
    shape: tuple[int, int],
    *,
    axis_bits: int,
    with_inverse: bool = False,
) -> tuple[Int32[torch.Tensor, 'k m'], Int32[torch.Tensor, 'k n'] | None] | None:
    """Neighbour table and, if asked for, its inverse; None if torch has to do it."""
    lib = _library(keys)
    if lib is None:
        return None
    keys, centres = keys.contiguous(), centres.contiguous()
    edge, height = shape
    offsets = edge * edge * height
    rows = torch.empty(offsets, len(centres), dtype=torch.int32)
    inverse = torch.empty(offsets, len(keys), dtype=torch.int32) if with_inverse else None
    lib.gcl_search(
        *(at(keys), LONG(len(keys)), at(centres), LONG(len(centres))),
        *(INT(edge), INT(height), INT(axis_bits)),
        *(at(rows), None if inverse is None else at(inverse), INT(torch.get_num_threads())),
    )
    return rows, inverse


def search_same(
    keys: Int64[torch.Tensor, ' n'], shape: tuple[int, int], *, axis_bits: int
) -> Int32[torch.Tensor, 'k n'] | None:
    """Neighbour table around the keys themselves, by odd lengths; None if torch has to do it."""
    edge, height = shape
    lib = _library(keys) if edge % 2 and height % 2 else None
    if lib is None:
        return None
    keys = keys.contiguous()
    rows = torch.empty(edge * edge * height, len(keys), dtype=torch.int32)
    lib.gcl_search_same(
        *(at(keys), LONG(len(keys)), INT(edge), INT(height), INT(axis_bits)),
        *(at(rows), INT(torch.get_num_threads())),
    )
    return rows


def unique(
    keys: Int64[torch.Tensor, ' n'], *, axis_bits: int
) -> tuple[Int64[torch.Tensor, ' m'], Int64[torch.Tensor, ' n']] | None:
    """Sorted different keys, and which of them each one is; None if torch has to do it."""
    lib = _library(keys)
    if lib is None:
        return None
    keys = keys.contiguous()
    different, row = torch.empty_like(keys), torch.empty_like(keys)
    lib.gcl_unique.restype = LONG
    count = lib.gcl_unique(at(keys), LONG(len(keys)), INT(axis_bits), at(different), at(row))
    return None if count < 0 else (different[:count].clone(), row)


def halving_map(
    fine: Int64[torch.Tensor, ' n'],
    parent: Int64[torch.Tensor, ' n'],
    count: int,
    *,
    axis_bits: int,
) -> tuple[Int32[torch.Tensor, '8 m'], Int32[torch.Tensor, '8 n']] | None:
    """Table of the fine voxels in each of `count` coarse ones, and its inverse; None as above."""
    lib = _library(fine)
    if lib is None:
        return None
    fine, parent = fine.contiguous(), parent.contiguous()
    rows = torch.empty(8, count, dtype=torch.int32)
    inverse = torch.empty(8, len(fine), dtype=torch.int32)
    lib.gcl_halving_map(
        *(at(fine), LONG(len(fine)), at(parent), LONG(count), INT(axis_bits)),
        *(at(rows), at(inverse)),
    )
    return rows, inverse


def _library(keys: torch.Tensor) -> ctypes.CDLL | None:
    return library() if keys.device.type == 'cpu' else None
