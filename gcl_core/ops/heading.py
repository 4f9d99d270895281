"""The direction that walls, hedges and kerb-side cars follow: a heading that scans agree on."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int64

CELL = 0.3  # metres: one vote for each occupied column, however tall
BLOCK = 2.0  # metres: length of the pieces whose directions are taken
GROUND_CELL = 4.0  # metres
SOLID_HEIGHT = 0.5  # metres over the lowest point of its ground cell
NEAREST, FARTHEST = 3.0, 60.0  # metres from the sensor: neither the own vehicle nor single returns
FEWEST = 4  # columns in a piece
THICKNESS = 0.02  # square metres: a piece this short has no direction


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
    flat = np.hypot(points[:, 0], points[:, 1])
    points = points[(flat > NEAREST) & (flat < FARTHEST)]
    cell = torch.from_numpy(_cells(points[:, :2], GROUND_CELL))
    height = torch.from_numpy(np.ascontiguousarray(points[:, 2]))
    lowest = torch.full((_side(GROUND_CELL) ** 2,), np.inf, dtype=height.dtype)
    lowest.scatter_reduce_(0, cell, height, 'amin')
    solid = points[(height - lowest[cell] > SOLID_HEIGHT).numpy()]
    occupied = np.zeros(_side(CELL) ** 2, bool)
    occupied[_cells(solid[:, :2], CELL)] = True
    rows, columns = np.divmod(np.flatnonzero(occupied), _side(CELL))
    where = (np.stack([rows, columns], 1) - _side(CELL) // 2 + 0.5) * CELL
    vote = sum(_votes(where, shift) for shift in (0.0, 0.5 * BLOCK))
    heading = float(np.angle(vote)) / 4
    return heading if heading < np.pi / 4 else -np.pi / 4


def _votes(where: Float[np.ndarray, 'n 2'], shift: float) -> complex:
    """Sum of the pieces' directions, four times as fast; pieces begin at `shift`."""
    piece = _cells(where + shift, BLOCK)
    count = np.maximum(np.bincount(piece), 1)
    x, y = (where[:, i] - (np.bincount(piece, where[:, i]) / count)[piece] for i in (0, 1))
    xx, yy, xy = (np.bincount(piece, p) / count for p in (x * x, y * y, x * y))
    spread = np.hypot(xx - yy, 2 * xy)
    weight = np.where(count >= FEWEST, count * (spread / (xx + yy + THICKNESS)) ** 4, 0.0)
    twice = np.arctan2(2 * xy, xx - yy)
    return complex((weight * np.exp(2j * twice)).sum())


def _side(cell: float) -> int:
    """Cells along an edge of the square that holds all points, the origin between two."""
    return 2 * (int(FARTHEST / cell) + 2)


def _cells(xy: Float[np.ndarray, 'n 2'], cell: float) -> Int64[np.ndarray, ' n']:
    """Index of each point's cell in that square."""
    place = np.floor(xy / cell).astype(np.int64) + _side(cell) // 2
    return np.asarray(place[:, 0] * _side(cell) + place[:, 1])
