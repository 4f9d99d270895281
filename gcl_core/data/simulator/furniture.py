"""What stands and moves on a street: poles, signs, fences, bins, vehicles, people."""

from __future__ import annotations

import numpy as np

from gcl_core.data.simulator.primitives import Triangles, box, cylinder, extrude, place

# (x, z) outlines in units of length and height, clockwise seen from +y
_OUTLINES = {
    'sedan': [(0, 0.45), (0, 0.15), (1, 0.15), (1, 0.5), (0.98, 0.62), (0.72, 0.66)]
    + [(0.58, 1.0), (0.28, 1.0), (0.14, 0.68), (0.01, 0.64)],
    'hatch': [(0, 0.5), (0, 0.15), (1, 0.15), (1, 0.45), (0.97, 0.58), (0.74, 0.64)]
    + [(0.58, 1.0), (0.14, 1.0), (0.02, 0.65)],
    'van': [(0, 0.95), (0, 0.1), (1, 0.1), (1, 0.45), (0.87, 0.55), (0.76, 1.0), (0.02, 1.0)],
}


def car(rng: np.random.Generator) -> Triangles:
    """Parked or moving car or van, wheels' height off the ground, facing +x."""
    kind = rng.choice(['sedan', 'hatch', 'van'], p=[0.45, 0.4, 0.15])
    length, width, height = {
        'sedan': (4.6, 1.8, 1.45),
        'hatch': (4.0, 1.75, 1.5),
        'van': (5.3, 2.0, 2.2),
    }[str(kind)]
    length, height = length * rng.uniform(0.92, 1.08), height * rng.uniform(0.95, 1.15)
    outline = (np.array(_OUTLINES[str(kind)]) - [0.5, 0.0]) * [length, height]
    return extrude(outline, width, top_inset=0.2)


def truck(rng: np.random.Generator) -> Triangles:
    """Truck or bus, facing +x."""
    length, height = rng.uniform(6.0, 12.0), rng.uniform(2.6, 3.6)
    return np.concatenate(
        [
            place(box(length, 2.4, height - 0.6), z=0.6),
            place(box(2.0, 2.3, 0.8 * height - 0.4), x=length / 2 + 1.1, z=0.4),
        ]
    )


def person(rng: np.random.Generator) -> Triangles:
    """Pedestrian, or a cyclist when wide."""
    height = rng.uniform(1.5, 1.9)
    parts = [cylinder(rng.uniform(0.18, 0.28), height, sides=6)]
    if rng.random() < 0.3:
        parts.append(place(box(1.7, 0.1, 0.6), z=0.3))
    return np.concatenate(parts)


def pole(rng: np.random.Generator) -> Triangles:
    """Street lamp, utility pole, traffic light or sign at the origin."""
    kind = rng.random()
    if kind < 0.4:
        height = rng.uniform(4.5, 9.0)
        arm = rng.uniform(0.5, 2.0)
        return np.concatenate(
            [
                cylinder(rng.uniform(0.06, 0.12), height, sides=6),
                place(box(arm, 0.15, 0.12), y=0.0, x=arm / 2, z=height),
            ]
        )
    if kind < 0.55:
        return cylinder(rng.uniform(0.1, 0.18), rng.uniform(6.0, 10.0), sides=6)
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
    parts = [place(box(length, 0.05, 0.08), z=z * height) for z in (0.2, 0.85)]
    for x in np.arange(-length / 2, length / 2, pitch):
        parts.append(place(box(rng.uniform(0.05, 0.12), 0.03, height), x=float(x)))
    return np.concatenate(parts)
