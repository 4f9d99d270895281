"""What moves, or is parked: cars, vans, trucks, buses, people, cyclists; all facing +x."""

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
_SIZES = {'sedan': (4.6, 1.8, 1.45), 'hatch': (4.0, 1.75, 1.5), 'van': (5.3, 2.0, 2.2)}


def car(rng: np.random.Generator) -> Triangles:
    """Car or delivery van on its wheels."""
    kind = str(rng.choice(list(_OUTLINES), p=[0.42, 0.38, 0.2]))
    length, width, height = _SIZES[kind]
    length, height = length * rng.uniform(0.92, 1.08), height * rng.uniform(0.95, 1.15)
    outline = (np.array(_OUTLINES[kind]) - [0.5, 0.0]) * [length, height]
    parts = [extrude(outline, width, top_inset=0.2)]
    for x in (-0.31, 0.31):
        for y in (-0.5, 0.5):
            wheel = place(box(0.62, 0.2, 0.62), x=x * length, y=y * (width - 0.25))
            parts.append(wheel)
    return np.concatenate(parts)


def truck(rng: np.random.Generator) -> Triangles:
    """Truck with a cab, or a bus in one piece."""
    length, height = rng.uniform(6.0, 12.0), rng.uniform(2.6, 3.6)
    body = place(box(length, 2.45, height - 0.6), z=0.6)
    chassis = place(box(length, 1.2, 0.4), z=0.3)
    if rng.random() < 0.35:
        return np.concatenate([place(box(length, 2.5, height - 0.35), z=0.35), chassis])
    cab = place(box(2.0, 2.3, 0.8 * height - 0.4), x=length / 2 + 1.1, z=0.4)
    return np.concatenate([body, chassis, cab])


def road_vehicle(rng: np.random.Generator, *, trucks: float = 0.12) -> Triangles:
    """Car or, with probability `trucks`, a truck or bus."""
    return truck(rng) if rng.random() < trucks else car(rng)


def person(rng: np.random.Generator) -> Triangles:
    """Pedestrian in mid-stride."""
    height, stride = rng.uniform(1.5, 1.9), rng.uniform(0.05, 0.3)
    torso = cylinder(rng.uniform(0.18, 0.26), 0.4 * height, sides=6, top_radius=0.2)
    return np.concatenate(
        [
            place(torso, z=0.46 * height),
            place(cylinder(0.11, 0.14 * height, sides=5), z=0.86 * height),
            place(cylinder(0.09, 0.47 * height, sides=4), x=stride, y=0.09),
            place(cylinder(0.09, 0.47 * height, sides=4), x=-stride, y=-0.09),
        ]
    )


def cyclist(rng: np.random.Generator) -> Triangles:
    """Somebody on a bicycle."""
    rider = place(cylinder(0.22, 0.75, sides=6), z=0.95)
    head = place(cylinder(0.11, 0.25, sides=5), z=1.6)
    bicycle = place(box(rng.uniform(1.5, 1.8), 0.06, 0.7), z=0.15)
    return np.concatenate([rider, head, bicycle, place(box(0.06, 0.5, 0.1), x=0.5, z=1.0)])
