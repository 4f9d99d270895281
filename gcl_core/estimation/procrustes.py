"""Closed-form transforms from correspondences, batched."""

from __future__ import annotations

from functools import reduce

import torch
from jaxtyping import Float


def products(
    source: Float[torch.Tensor, 'n 3'], target: Float[torch.Tensor, 'n 3']
) -> Float[torch.Tensor, 'n 17']:
    """Columns for correspondences p -> q: |p|^2 + |q|^2, 1, p, q, and q p^T row by row."""
    outer = (target.unsqueeze(2) * source.unsqueeze(1)).flatten(1)
    squares = (source.square() + target.square()).sum(1, keepdim=True)
    return torch.cat([squares, torch.ones_like(squares), source, target, outer], 1)


def from_moments(moments: Float[torch.Tensor, 'h 17']) -> Float[torch.Tensor, 'h 4 4']:
    """Least-squares rigid transforms from weighted sums of `products` (Kabsch, 1976), float64.

    The first column is not used; the second, the sum of the weights, must be positive.
    """
    total = moments[:, 1:2].clamp(min=1e-12)
    p_mean, q_mean = moments[:, 2:5] / total, moments[:, 5:8] / total
    spread = (moments[:, 8:] / total).view(-1, 3, 3) - q_mean.unsqueeze(2) * p_mean.unsqueeze(1)
    u, _, vt = torch.linalg.svd(spread)
    mirror = torch.ones_like(p_mean)
    mirror[:, 2] = torch.sign(torch.linalg.det(u @ vt))
    T = torch.eye(4, dtype=moments.dtype).repeat(len(moments), 1, 1)
    T[:, :3, :3] = (u * mirror.unsqueeze(1)) @ vt
    T[:, :3, 3] = q_mean - (T[:, :3, :3] @ p_mean.unsqueeze(2)).squeeze(2)
    return T


def _assemble(
    rotation: Float[torch.Tensor, 'h 3 3'],
    source: Float[torch.Tensor, 'h k 3'],
    target: Float[torch.Tensor, 'h k 3'],
) -> Float[torch.Tensor, 'h 4 4']:
    """Add the translation that brings the mean of the source points onto the target's."""
    T = torch.eye(4, dtype=source.dtype).repeat(len(source), 1, 1)
    T[:, :3, :3] = rotation
    p, q = (reduce(torch.add, side.unbind(1)) / side.shape[1] for side in (source, target))
    T[:, :3, 3] = q - (rotation @ p.unsqueeze(2)).squeeze(2)
    return T


def from_two_points(
    source: Float[torch.Tensor, 'h 2 3'], target: Float[torch.Tensor, 'h 2 3']
) -> Float[torch.Tensor, 'h 4 4']:
    """Yaw and translation from two correspondences each: both vehicles stand level."""
    (px, py, _), (qx, qy, _) = ((x[:, 1] - x[:, 0]).unbind(1) for x in (source, target))
    cosine, sine = px * qx + py * qy, px * qy - py * qx
    length = (cosine.square() + sine.square()).sqrt()
    rotation = torch.eye(3, dtype=source.dtype).repeat(len(source), 1, 1)
    rotation[:, 0, 0] = rotation[:, 1, 1] = torch.where(length > 0, cosine / length, 1.0)
    rotation[:, 1, 0] = torch.where(length > 0, sine / length, 0.0)
    rotation[:, 0, 1] = -rotation[:, 1, 0]
    return _assemble(rotation, source, target)


def _triad(points: Float[torch.Tensor, 'h 3 3']) -> Float[torch.Tensor, 'h 3 3']:
    """Orthonormal axes attached to three points, as columns."""
    first = torch.nn.functional.normalize(points[:, 1] - points[:, 0], dim=1)
    normal = torch.linalg.cross(first, points[:, 2] - points[:, 0])
    normal = torch.nn.functional.normalize(normal, dim=1)
    return torch.stack([first, torch.linalg.cross(normal, first), normal], 2)


def from_three_points(
    source: Float[torch.Tensor, 'h 3 3'], target: Float[torch.Tensor, 'h 3 3']
) -> Float[torch.Tensor, 'h 4 4']:
    """Rigid transform from three correspondences each, by aligning triads (Horn, 1987)."""
    rotation = _triad(target) @ _triad(source).transpose(1, 2)
    return _assemble(rotation, source, target)
