"""Houses: walls with windows, roofs, and what grows on facades."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core.data.simulator.primitives import Triangles, box, gable_roof, place, quad

PANE_DEPTH = 0.18  # metres from the outer wall to the glass
PANE_SHARE = 0.6  # of windows whose glass or curtain returns the beam; the others are see-through


def _breaks(length: float, opening: float, margin: float, pitch: float) -> Float[np.ndarray, ' n']:
    """Edges of a row of equal openings, wall first and wall last."""
    count = max(1, int((length - 2 * margin) // pitch))
    centres = (np.arange(count) + 0.5) / count * (length - 2 * margin) + margin
    edges = np.stack([centres - opening / 2, centres + opening / 2], 1).ravel()
    return np.concatenate([[0.0], edges, [length]])


def wall(length: float, height: float, storeys: int, rng: np.random.Generator) -> Triangles:
    """Wall in the x-z plane from the origin along +x, outside at -y, with a grid of windows."""
    opening, storey = rng.uniform(0.8, 1.8), height / storeys
    tall = min(rng.uniform(1.0, 1.6), 0.6 * storey)
    columns = _breaks(length, opening, 0.5, opening + rng.uniform(0.9, 2.6))
    sill = rng.uniform(0.3, 0.4) * storey
    rows = np.concatenate(
        [[0.0], *[[s * storey + sill, s * storey + sill + tall] for s in range(storeys)], [height]]
    )
    grid = np.meshgrid(np.arange(len(columns) - 1), np.arange(len(rows) - 1), indexing='ij')
    i, k = (index.ravel() for index in grid)
    window = (i % 2 == 1) & (k % 2 == 1) & (rng.random(len(i)) < 0.85)
    pane = window & (rng.random(len(i)) < PANE_SHARE)
    parts = []
    for cells, depth in ((~window, 0.0), (pane, PANE_DEPTH)):
        corners = np.full((4, int(cells.sum()), 3), depth)
        for corner, (right, up) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
            corners[corner, :, 0] = columns[i[cells] + right]
            corners[corner, :, 2] = rows[k[cells] + up]
        parts.append(quad(*corners))
    return np.concatenate(parts)


def _facade_parts(length: float, width: float, height: float, rng: np.random.Generator) -> list:
    """Porch, bay, balcony, garage, steps, drain pipes, on the front (-y) or the sides."""
    front = -width / 2
    parts = []

    def add(part: Triangles, x: float, y: float, z: float = 0.0) -> None:
        parts.append(place(part, x=x, y=y, z=z))

    def along() -> float:
        return float(rng.uniform(-0.4, 0.4) * length)

    if rng.random() < 0.4:
        x, deep, wide = along(), rng.uniform(1.0, 2.5), rng.uniform(1.5, 4.0)
        add(box(wide, deep, 0.2), x, front - deep / 2, rng.uniform(2.3, 2.8))
        for side in (-1, 1):
            add(box(0.2, 0.2, 2.5), x + side * wide / 2, front - deep)
    if rng.random() < 0.35:
        deep = rng.uniform(0.5, 1.5)
        add(box(rng.uniform(1.5, 3.5), deep, rng.uniform(2.5, height)), along(), front - deep / 2)
    if rng.random() < 0.35 and height > 5:
        deep = rng.uniform(0.8, 1.6)
        add(box(rng.uniform(2, 5), deep, 1.1), along(), front - deep / 2, rng.uniform(2.6, 3.2))
    if rng.random() < 0.35:
        side, wide = rng.choice([-1, 1]), rng.uniform(3.0, 6.0)
        deep = rng.uniform(0.6, 1.0) * width
        add(
            box(wide, deep, rng.uniform(2.4, 3.2)),
            side * (length + wide) / 2,
            front + deep / 2 + rng.uniform(-2.0, 2.0),
        )
    for _ in range(rng.integers(0, 3)):
        add(
            box(rng.uniform(1.0, 2.0), rng.uniform(0.6, 1.5), rng.uniform(0.2, 0.8)),
            along(),
            front,
        )
    for _ in range(rng.integers(0, 3)):
        add(box(0.12, 0.12, height), along(), front - 0.08)
    return parts


def house(
    length: float,
    width: float,
    height: float,
    rng: np.random.Generator,
    *,
    flat: bool = False,
    gable_along: bool | None = None,
) -> Triangles:
    """Detached house or block around the origin, front towards -y, ground at z = 0."""
    storeys = max(1, round(height / 3.0))
    parts = _facade_parts(length, width, height, rng)
    for yaw, run, depth in (
        (0.0, length, width),
        (np.pi / 2, width, length),
        (np.pi, length, width),
        (-np.pi / 2, width, length),
    ):
        side = place(wall(run, height, storeys, rng), x=-run / 2, y=-depth / 2)
        parts.append(place(side, yaw=yaw))
    if flat:
        parts.append(place(box(length + 0.3, width + 0.3, rng.uniform(0.3, 1.0)), z=height))
    else:
        rise = rng.uniform(0.25, 0.5) * min(length, width)
        along_street = rng.random() < 0.6 if gable_along is None else gable_along
        roof = gable_roof(length, width, rise) if along_street else gable_roof(width, length, rise)
        parts.append(place(roof, z=height, yaw=0.0 if along_street else np.pi / 2))
        if rng.random() < 0.6:
            x = rng.uniform(-0.3, 0.3) * length
            parts.append(place(box(0.6, 0.6, rise + 1.0), x=x, z=height))
    return np.concatenate(parts)


def hall(length: float, width: float, height: float, rng: np.random.Generator) -> Triangles:
    """Factory, warehouse or supermarket: bare ribbed walls, gates, a flat or low roof."""
    parts = [box(length, width, height)]
    for x in np.arange(-length / 2, length / 2, rng.uniform(3.0, 8.0)):
        parts.append(place(box(0.3, width + 0.4, height), x=float(x)))
    for _ in range(rng.integers(1, 4)):
        gate = box(rng.uniform(3, 5), rng.uniform(0.5, 3.0), rng.uniform(0.3, 1.2))
        parts.append(place(gate, x=rng.uniform(-0.4, 0.4) * length, y=-width / 2))
    if rng.random() < 0.5:
        parts.append(place(gable_roof(length, width, rng.uniform(0.08, 0.2) * width), z=height))
    else:
        for _ in range(rng.integers(0, 4)):
            x, y = rng.uniform(-0.4, 0.4, 2)
            vent = box(*rng.uniform(1.0, 3.0, 3))
            parts.append(place(vent, x=x * length, y=y * width, z=height))
    return np.concatenate(parts)


def silhouette(length: float, width: float, height: float, rng: np.random.Generator) -> Triangles:
    """Distant building: bare walls, a roof."""
    if rng.random() < 0.4:
        return box(length, width, height)
    roof = gable_roof(length, width, rng.uniform(0.25, 0.5) * min(length, width))
    return np.concatenate([box(length, width, height), place(roof, z=height)])
