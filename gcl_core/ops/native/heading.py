"""The compiled votes for a heading as a function of tensors, see `gcl_core.ops.heading`."""

from __future__ import annotations

import ctypes

import torch
from jaxtyping import Float, Int32

from gcl_core.ops.native.build import library
from gcl_core.ops.native.kernels import INT, at


def heading_votes(
    points: Float[torch.Tensor, 'n 3'],
    *,
    within: tuple[float, float],
    ground: tuple[float, int],
    solid_height: float,
    columns: tuple[float, int],
    piece: Int32[torch.Tensor, 'shifts side'],
    pieces: int,
    fewest: int,
    thin: float,
    scale: float,
) -> tuple[int, int] | None:
    """Sum of the votes times `scale`; None if numpy has to do it.

    Args:
        points: one scan.
        within: distances from the sensor between which points count, metres.
        ground: edge of a cell in metres, and cells along the edge of their grid.
        solid_height: over the lowest point of its ground cell, metres.
        columns: likewise.
        piece: row of pieces of each row of columns, for each of two ways to cut.
        pieces: rows of them.
        fewest: columns in a piece that votes.
        thin: square columns that are added to a piece's spread.
        scale: of the result.
    """
    lib = library() if points.dtype == torch.float32 else None
    if lib is None:
        return None
    points, vote = points.contiguous(), torch.zeros(2, dtype=torch.int64)
    cut = [*within, ground[0], solid_height, columns[0], thin, scale]
    lib.gcl_heading(
        *(at(points), ctypes.c_int64(len(points)), at(torch.tensor(cut, dtype=torch.float64))),
        *(INT(ground[1]), INT(columns[1]), at(piece), INT(pieces), INT(fewest), at(vote)),
    )
    along, across = vote.tolist()
    return along, across
