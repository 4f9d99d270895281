"""What stands on and beside a street: poles, signs, fences, walls, bins, bridges."""

from __future__ import annotations

import numpy as np

from gcl_core.data.simulator.primitives import Triangles, box, cylinder, place


def lamp(rng: np.random.Generator) -> Triangles:
    """Street lamp with an arm, or a utility pole, at the origin."""
    if rng.random() < 0.25:
        bar = place(box(0.12, 1.8, 0.12), z=6.0)
        return np.concatenate([cylinder(0.14, rng.uniform(6.5, 10.0), sides=6), bar])
    height, arm = rng.uniform(4.5, 9.0), rng.uniform(0.5, 2.0)
    return np.concatenate(
        [
            cylinder(rng.uniform(0.06, 0.12), height, sides=6),
            place(box(arm, 0.15, 0.12), x=arm / 2, z=height),
        ]
    )


def sign(rng: np.random.Generator) -> Triangles:
    """Traffic sign or traffic light at the origin."""
    height = rng.uniform(1.8, 3.2)
    plate = box(0.05, rng.uniform(0.4, 0.8), rng.uniform(0.4, 0.9))
    return np.concatenate([cylinder(0.04, height, sides=6), place(plate, z=height - 0.5)])


def clutter(rng: np.random.Generator) -> Triangles:
    """Bin, cabinet, bollard, bench or heap."""
    size = rng.uniform([0.2, 0.2, 0.4], [1.8, 0.8, 1.5])
    return box(*size)


def fence(length: float, rng: np.random.Generator) -> Triangles:
    """Picket fence or solid wall along x around the origin."""
    height = rng.uniform(0.5, 1.6)
    if rng.random() < 0.4:
        return box(length, rng.uniform(0.1, 0.3), height)
    pitch = rng.uniform(0.18, 0.5)
    rails = [place(box(length, 0.05, 0.08), z=z * height) for z in (0.2, 0.85)]
    x = np.arange(-length / 2, length / 2, pitch)
    return np.concatenate([*rails, _row(box(rng.uniform(0.05, 0.12), 0.03, height), x)])


def wall(length: float, rng: np.random.Generator) -> Triangles:
    """Wall of 1 to 3.5 m along x, with piers or bare."""
    height = rng.uniform(1.0, 3.5)
    body = box(length, rng.uniform(0.2, 0.5), height)
    if rng.random() < 0.5:
        return body
    x = np.arange(-length / 2, length / 2, rng.uniform(2.0, 6.0))
    return np.concatenate([body, _row(box(0.4, 0.7, height + 0.15), x)])


def guard_rail(length: float) -> Triangles:
    """Crash barrier along x: a band on posts every 2 m."""
    x = np.arange(-length / 2, length / 2, 2.0)
    band = place(box(length, 0.08, 0.31), z=0.45)
    return np.concatenate([band, _row(box(0.1, 0.1, 0.5), x)])


def bridge(clear: float, length: float, rng: np.random.Generator) -> Triangles:
    """Bridge over the road, which runs along x: a deck, abutments and railings.

    Args:
        clear: half the free width between the abutments, metres.
        length: extent along the road, metres.
        rng: decides on the height, and how thick the deck is.
    """
    height, reach = rng.uniform(4.5, 6.5), 70.0
    parts = [place(box(length, 2 * reach, rng.uniform(0.6, 1.4)), z=height)]
    for side in (-1, 1):
        slab = box(length, reach - clear, height + 0.1)
        parts.append(place(slab, y=side * (clear + reach) / 2))
        parts.append(place(box(0.15, 2 * reach, 1.1), x=side * length / 2, z=height + 1.0))
    return np.concatenate(parts)


def _row(part: Triangles, x: np.ndarray) -> Triangles:
    """Copies of a part at each x."""
    shift = np.zeros((len(x), 1, 1, 3), dtype=np.float32)
    shift[..., 0] = x[:, None, None]
    return (part[None] + shift).reshape(-1, 3, 3).astype(np.float32)
