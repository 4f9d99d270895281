"""The direction that walls, hedges and kerb-side cars follow: a heading that scans agree on.

All that is added up is a whole number, so that neither the order of the points nor a quarter turn
of the scan changes a bit of the result; the compiled twin (native/heading.cpp) gives the same.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float, Int32, Int64

from gcl_core.ops.native.heading import heading_votes

CELL = 0.3  # metres: one vote for each occupied column, however tall
BLOCK = 2.0  # metres: length of the pieces whose directions are taken
GROUND_CELL = 4.0  # metres
SOLID_HEIGHT = 0.5  # metres over the lowest point of its ground cell
NEAREST, FARTHEST = 3.0, 60.0  # metres from the sensor: neither the own vehicle nor single returns
FEWEST = 4  # columns in a piece
THICKNESS = 0.02  # square metres: a piece this short has no direction
THIN = THICKNESS / CELL**2
SCALE = 2.0**40  # of the votes, which are at most 49 each, as whole numbers


def dominant_heading(points: Float[np.ndarray, 'n 3']) -> float:
    """Main horizontal direction of what stands on the ground, radians within [-pi/4, pi/4[.

    It is a property of the place, not of the vehicle: turned by its negative, scans of one street
    face the same way but for a number of quarter turns. Columns that stand up from the ground are
    cut into pieces of 2 m; each piece votes by its principal axis, the more the thinner it is; the
    votes are averaged as angles that repeat every quarter turn. Curved streets and woods have no
    single direction: there it changes from place to place.

    Args:
        points: one scan, z up within a few degrees.
    """
    compiled = heading_votes(
        torch.from_numpy(np.ascontiguousarray(points)),
        within=(NEAREST, FARTHEST),
        ground=(GROUND_CELL, _side(GROUND_CELL)),
        solid_height=SOLID_HEIGHT,
        columns=(CELL, _side(CELL)),
        piece=torch.from_numpy(_piece_of_columns()),
        pieces=_side(BLOCK),
        fewest=FEWEST,
        thin=THIN,
        scale=SCALE,
    )
    along, across = compiled or _votes(points)
    heading = math.atan2(across, along) / 4
    return heading if heading < np.pi / 4 else -np.pi / 4


def _votes(points: Float[np.ndarray, 'n 3']) -> tuple[int, int]:
    """Sum of the pieces' directions, four times as fast, times `SCALE`."""
    columns = _standing(points)
    pieces = (cut[columns].astype(np.int64) for cut in _piece_of_columns())
    votes = [_directions(columns, p[:, 0] * _side(BLOCK) + p[:, 1]) for p in pieces]
    along, across = (sum(part) for part in zip(*votes))
    return int(along), int(across)


def _standing(points: Float[np.ndarray, 'n 3']) -> Int64[np.ndarray, 'n 2']:
    """Columns, each once, with a point that stands up from the ground."""
    x, y = points[:, :2].T.astype(np.float64)
    flat = x * x + y * y
    points = points[(flat > NEAREST**2) & (flat < FARTHEST**2)]
    cell = torch.from_numpy(_cells(points[:, :2], GROUND_CELL))
    height = torch.from_numpy(np.ascontiguousarray(points[:, 2]))
    lowest = torch.full((_side(GROUND_CELL) ** 2,), np.inf, dtype=height.dtype)
    lowest.scatter_reduce_(0, cell, height, 'amin')
    solid = points[(height - lowest[cell] > SOLID_HEIGHT).numpy()]
    occupied = np.unique(_cells(solid[:, :2], CELL))
    return np.stack(np.divmod(occupied, _side(CELL)), 1)


def _directions(
    columns: Int64[np.ndarray, 'n 2'], piece: Int64[np.ndarray, ' n']
) -> tuple[int, int]:
    """Sum of the pieces' votes, in `SCALE`ths; `piece` says which each column belongs to."""
    x, y = (columns - _side(CELL) // 2).T
    n = np.bincount(piece).astype(float)
    sx, sy, sxx, syy, sxy = (np.bincount(piece, p) for p in (x, y, x * x, y * y, x * y))
    xx, yy, xy = n * sxx - sx * sx, n * syy - sy * sy, n * sxy - sx * sy  # n^2 times, exact
    across, along = xx - yy, 2 * xy
    thick = ((xx + yy) / THIN + n * n) * THIN  # so divided, no compiler rounds otherwise
    squared = np.maximum(thick * thick, 1.0)  # where there is no column
    weight = n * (across * across + along * along) / (squared * squared)
    weight[n < FEWEST] = 0.0
    doubled = across * across - along * along, 2 * across * along
    c, s = (np.rint(weight * d * SCALE).astype(np.int64).sum() for d in doubled)
    return int(c), int(s)


def _piece_of_columns() -> Int32[np.ndarray, 'shifts side']:
    """Row of pieces of each row of columns, for pieces that begin at 0 and half-way between."""
    middle = (np.arange(_side(CELL)) - _side(CELL) // 2 + 0.5) * CELL
    shifts = np.array([[0.0], [0.5 * BLOCK]])
    return (np.floor((middle + shifts) / BLOCK) + _side(BLOCK) // 2).astype(np.int32)


def _side(cell: float) -> int:
    """Cells along an edge of the square that holds all points, the origin between two."""
    return 2 * (int(FARTHEST / cell) + 2)


def _cells(xy: Float[np.ndarray, 'n 2'], cell: float) -> Int64[np.ndarray, ' n']:
    """Index of each point's cell in that square."""
    place = np.floor(xy / cell).astype(np.int64) + _side(cell) // 2
    return np.asarray(place[:, 0] * _side(cell) + place[:, 1])
