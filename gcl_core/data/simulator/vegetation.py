"""Trees, bushes and hedges: porous, so that beams reach what is behind them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core.data.simulator.primitives import Triangles, box, cylinder, leaves, place

PRUNED = 3.2  # metres below the crown of a tree beside the road


def _blob(
    count: int, radii: Float[np.ndarray, '3'], rng: np.random.Generator
) -> Float[np.ndarray, 'n 3']:
    """Points in an ellipsoid, denser towards its surface, where leaves are."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * radii * rng.uniform(0.1, 1.0, size=(count, 1)) ** 0.6


def tree(rng: np.random.Generator, *, detail: float = 1.0, roadside: bool = False) -> Triangles:
    """Deciduous or conical tree, 3 to 14 m, trunk at the origin.

    Args:
        rng: decides on its shape.
        detail: share of its leaves, which are larger the fewer they are; less for distant trees.
        roadside: pruned, so that vehicles pass below its crown.
    """
    height = rng.uniform(3.5, 14.0)
    trunk = cylinder(rng.uniform(0.08, 0.35), 0.6 * height, sides=7, top_radius=0.06)
    count = int(detail * rng.uniform(50, 150) * height)
    if rng.random() < 0.25 and not roadside:
        level = rng.random(count) ** 1.5
        reach = (1.0 - level) * rng.uniform(0.15, 0.25) * height
        angle = rng.uniform(0, 2 * np.pi, count)
        bottom = rng.uniform(0.3, 1.5)
        z = bottom + level * (height - bottom)
        centres = np.stack([reach * np.cos(angle), reach * np.sin(angle), z], 1)
    else:
        crown_base = rng.uniform(0.2, 0.45) * height
        if roadside:
            crown_base = max(crown_base, PRUNED)
            height = max(height, crown_base + 2.5)
        spread, clumps = rng.uniform(0.15, 0.3) * height, rng.integers(4, 10)
        parts = []
        for _ in range(clumps):
            radii = rng.uniform(0.3, 0.9, 3) * np.array([spread, spread, 0.3 * height])
            offset = rng.normal(size=2) * 0.5 * spread
            z = rng.uniform(crown_base + radii[2], max(height - radii[2], crown_base + radii[2]))
            parts.append(_blob(count // clumps, radii, rng) + [offset[0], offset[1], z])
        centres = np.concatenate(parts)
    return np.concatenate([trunk, leaves(centres, rng.uniform(0.09, 0.2) / detail**0.5, rng)])


def bush(rng: np.random.Generator) -> Triangles:
    """Shrub of 0.5 to 2.5 m."""
    radii = rng.uniform([0.4, 0.4, 0.3], [1.5, 1.5, 1.3])
    centres = _blob(int(rng.uniform(80, 350)), radii, rng) + [0, 0, radii[2] * 0.8]
    return leaves(centres, rng.uniform(0.07, 0.16), rng)


def hedge(length: float, rng: np.random.Generator) -> Triangles:
    """Hedge along x around the origin: a core with uneven height under loose leaves."""
    height, width = rng.uniform(0.6, 1.8), rng.uniform(0.5, 1.2)
    pieces = max(1, int(length / 1.5))
    parts = []
    for i in range(pieces):
        core = box(
            length / pieces, 0.6 * width * rng.uniform(0.7, 1.2), height * rng.uniform(0.75, 0.95)
        )
        parts.append(place(core, x=(i + 0.5) / pieces * length - length / 2))
    count = int(length * height * rng.uniform(10, 25))
    centres = rng.uniform([-0.5, -0.5, 0.05], [0.5, 0.5, 1.0], (count, 3))
    centres[:, 1] = np.where(rng.random(count) < 0.7, np.sign(centres[:, 1]) * 0.5, centres[:, 1])
    parts.append(leaves(centres * [length, width, height], rng.uniform(0.1, 0.2), rng))
    return np.concatenate(parts)
