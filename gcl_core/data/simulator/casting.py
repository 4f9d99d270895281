"""Beams against triangles: what each beam hits first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from jaxtyping import Float32

from gcl_core.data.simulator.surfaces import Soup


@dataclass(frozen=True)
class Hits:
    """What each beam meets, in the shape of the sensor's image (beams, firings).

    Attributes:
        distance: metres; inf where nothing is hit.
        cosine: of the angle of incidence.
        reflectance: of the surface.
        depth: softness of the surface, metres.
    """

    distance: Float32[np.ndarray, 'r c']
    cosine: Float32[np.ndarray, 'r c']
    reflectance: Float32[np.ndarray, 'r c']
    depth: Float32[np.ndarray, 'r c']


class Scene:
    """Triangles that beams can be cast at."""

    def __init__(self, soup: Soup) -> None:
        self._soup = soup
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        vertices = np.ascontiguousarray(soup.triangles.reshape(-1, 3), dtype=np.float32)
        faces = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))

    def cast(self, rays: Float32[np.ndarray, 'r c 6']) -> Hits:
        """Cast rays (origin, unit direction)."""
        hit = self._scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)
        normal = hit['primitive_normals'].numpy()
        cosine = np.abs(np.einsum('rcx,rcx->rc', normal, rays[..., 3:]))
        triangle = hit['primitive_ids'].numpy()
        triangle = np.where(triangle < len(self._soup), triangle, 0)
        return Hits(
            hit['t_hit'].numpy(),
            cosine,
            self._soup.reflectance[triangle],
            self._soup.depth[triangle],
        )


def nearer(first: Hits, second: Hits, columns: np.ndarray) -> Hits:
    """Take `second`, cast in some columns only, where it is nearer than `first`."""
    closer = second.distance < first.distance[:, columns]
    merged = []
    for name in ('distance', 'cosine', 'reflectance', 'depth'):
        whole = getattr(first, name).copy()
        whole[:, columns] = np.where(closer, getattr(second, name), whole[:, columns])
        merged.append(whole)
    return Hits(*merged)
