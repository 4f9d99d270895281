"""Shapes as triangle soups: float32 arrays of shape (n, 3, 3), metres, z up."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Triangles = Float[np.ndarray, 'n 3 3']
OVERHANG = 0.4  # metres of a roof beyond its walls

_BOX_CORNERS = np.array(
    [[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)], dtype=np.float32
)
_BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    + [[2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3], [0, 2, 6], [0, 6, 4]]
)


def place(
    triangles: Triangles, *, x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0
) -> Triangles:
    """Turn about z by `yaw` radians, then move."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=np.float32)
    moved = triangles @ rotation.T + np.array([x, y, z], dtype=np.float32)
    return moved.astype(np.float32)


def quad(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> Triangles:
    """Two triangles for each row of four corners in order, each of shape (n, 3)."""
    corners = np.empty((2, len(a), 3, 3), dtype=np.float32)
    corners[:, :, 0] = a
    corners[0, :, 1], corners[0, :, 2] = b, c
    corners[1, :, 1], corners[1, :, 2] = c, d
    return corners.reshape(-1, 3, 3)


def box(length: float, width: float, height: float) -> Triangles:
    """Box standing on the origin, `length` along x."""
    size = np.array([length, width, height], dtype=np.float32)
    return (_BOX_CORNERS * size)[_BOX_FACES]


def cylinder(
    radius: float, height: float, sides: int = 8, top_radius: float | None = None
) -> Triangles:
    """Upright cylinder or cone stump without caps, standing on the origin."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], 1)
    upper = ring * (radius if top_radius is None else top_radius) + [0.0, 0.0, height]
    lower = ring * radius
    return quad(lower[:-1], lower[1:], upper[1:], upper[:-1])


def gable_roof(length: float, width: float, rise: float) -> Triangles:
    """Roof with its ridge along x and its eaves at z = 0, gables closed."""
    half_length, half_width = length / 2 + OVERHANG, width / 2 + OVERHANG
    ridge = np.array([[-half_length, 0.0, rise], [half_length, 0.0, rise]])
    sides = [
        quad(
            np.array([[-half_length, y, 0.0]]),
            np.array([[half_length, y, 0.0]]),
            ridge[1:],
            ridge[:1],
        )
        for y in (-half_width, half_width)
    ]
    gables = np.array(
        [
            [[x, -width / 2, 0.0], [x, width / 2, 0.0], [x, 0.0, rise]]
            for x in (-length / 2, length / 2)
        ]
    )
    return np.concatenate([*sides, gables.astype(np.float32)])


def extrude(profile: Float[np.ndarray, 'n 2'], width: float, top_inset: float) -> Triangles:
    """Sweep a star-shaped (x, z) outline along y; its upper half narrows by `top_inset`."""
    centre = profile.mean(0)
    height = profile[:, 1]
    inset = top_inset * np.clip((height - 0.55 * height.max()) / (0.45 * height.max()), 0, 1)
    rims = []
    for side in (-1.0, 1.0):
        y = side * (width / 2 - inset)
        rims.append(np.stack([profile[:, 0], y, profile[:, 1]], 1))
    left, right = rims
    surface = quad(left, np.roll(left, -1, 0), np.roll(right, -1, 0), right)
    caps = []
    for rim, side in zip(rims, (-1.0, 1.0), strict=True):
        hub = np.broadcast_to([centre[0], side * width / 2, centre[1]], rim.shape)
        caps.append(np.stack([hub, rim, np.roll(rim, -1, 0)], 1))
    return np.concatenate([surface, *caps]).astype(np.float32)


def leaves(centres: Float[np.ndarray, 'n 3'], size: float, rng: np.random.Generator) -> Triangles:
    """One randomly turned triangle at each centre: foliage that a beam passes between."""
    corners = rng.standard_normal((len(centres), 3, 3), dtype=np.float32)
    corners /= np.sqrt(np.einsum('nkx,nkx->nk', corners, corners))[..., None]
    corners *= np.float32(size) * (0.5 + 0.8 * rng.random((len(centres), 1, 1), dtype=np.float32))
    return corners + centres.astype(np.float32)[:, None]
