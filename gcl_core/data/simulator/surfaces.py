"""What a laser beam meets: how strongly each surface returns it, and how soft it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from gcl_core.data.simulator.primitives import Triangles


@dataclass(frozen=True)
class Surface:
    """Diffuse reflectances at about 900 nm, rounded, chosen for this project.

    Attributes:
        reflectance: median over objects; 1 is a white wall, above 1 retro-reflective.
        spread: standard deviation of its logarithm over objects.
        odd_share: share of an object's triangles that are of `odd_reflectance` instead.
        odd_reflectance: glass returns almost nothing, a number plate more than white paint.
        depth: metres that a beam enters before it returns (standard deviation).
    """

    reflectance: float
    spread: float
    odd_share: float = 0.0
    odd_reflectance: float = 0.0
    depth: float = 0.0


SURFACES = {
    'asphalt': Surface(0.16, 0.25),
    'ground': Surface(0.35, 0.25, depth=0.03),
    'facade': Surface(0.45, 0.5, 0.06, 0.004),
    'glass': Surface(0.1, 0.8, 0.5, 0.004),
    'paint': Surface(0.25, 0.9, 0.18, 0.004),
    'leaf': Surface(0.45, 0.3, depth=0.08),
    'metal': Surface(0.35, 0.6),
    'sign': Surface(4.0, 0.4, 0.3, 0.3),
    'cloth': Surface(0.3, 0.6),
}
NAMES = tuple(SURFACES)


@dataclass(frozen=True)
class Soup:
    """Triangles with what a beam needs to know of each.

    Attributes:
        triangles: corners, metres.
        reflectance: of each triangle.
        depth: softness of each triangle, metres.
    """

    triangles: Triangles
    reflectance: Float32[np.ndarray, ' n']
    depth: Float32[np.ndarray, ' n']

    def __len__(self) -> int:
        return len(self.triangles)


def soup(
    triangles: Triangles,
    owner: Int[np.ndarray, ' n'],
    surface: Int[np.ndarray, ' o'],
    rng: np.random.Generator,
) -> Soup:
    """Give every object a reflectance, and a share of its triangles the odd one.

    Args:
        triangles: of all objects.
        owner: object that each triangle belongs to.
        surface: index into `NAMES` for each object.
        rng: decides.
    """
    kinds = list(SURFACES.values())

    def column(name: str) -> Float[np.ndarray, ' o']:
        return np.array([getattr(kind, name) for kind in kinds])[surface]

    of_object = column('reflectance') * np.exp(rng.normal(size=len(surface)) * column('spread'))
    odd = rng.random(len(owner)) < column('odd_share')[owner]
    reflectance: np.ndarray = np.where(odd, column('odd_reflectance')[owner], of_object[owner])
    depth = column('depth')[owner]
    return Soup(triangles, reflectance.astype(np.float32), depth.astype(np.float32))
