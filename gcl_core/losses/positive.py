"""What belongs together shall look alike: L_PP and L_PV (paper, equations 3 and 4)."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64

from gcl_core.types import PositiveGroups

NORM_FLOOR = 1e-12  # keeps the gradient of a norm finite at zero


def norm(x: Float[torch.Tensor, '*n d']) -> Float[torch.Tensor, '*n']:
    """Euclidean norm with a finite gradient everywhere."""
    return (x.square().sum(-1) + NORM_FLOOR).sqrt()


def group_means(
    features: Float[torch.Tensor, 'n d'], groups: PositiveGroups
) -> Float[torch.Tensor, 'g d']:
    """Mean feature of each group, mu(g)."""
    total = features.new_zeros(len(groups), features.shape[1])
    total = total.index_add(0, groups.group, features[groups.member])
    return total / groups.sizes.unsqueeze(1)


def positive_pair(
    features: Float[torch.Tensor, 'n d'],
    groups: PositiveGroups,
    *,
    generator: torch.Generator,
    margin: float = 0.1,
    squared: bool = False,
) -> Float[torch.Tensor, '']:
    """L_PP: one random pair of different members of each group."""
    sizes = groups.sizes

    def below(most: Int64[torch.Tensor, ' g']) -> Int64[torch.Tensor, ' g']:
        return (torch.rand(len(groups), generator=generator).to(most.device) * most).long()

    first, step = below(sizes), 1 + below(sizes - 1)
    second = (first + step) % sizes
    start = groups.offsets[:-1]
    difference = features[groups.member[start + first]] - features[groups.member[start + second]]
    distance = difference.square().sum(1) if squared else norm(difference)
    return torch.relu(distance - margin).mean()


def positive_variance(
    features: Float[torch.Tensor, 'n d'],
    groups: PositiveGroups,
    *,
    margin: float = 0.1,
    squared: bool = False,
) -> Float[torch.Tensor, '']:
    """L_PV: distance of each member to its group's mean, averaged in the group, then over groups.

    The paper subtracts the margin for each member; public code once from the group's mean square.
    """
    group = groups.group
    difference = features[groups.member] - group_means(features, groups)[group]
    distance = difference.square().sum(1) if squared else torch.relu(norm(difference) - margin)
    total = features.new_zeros(len(groups)).index_add(0, group, distance) / groups.sizes
    return torch.relu(total - margin).mean() if squared else total.mean()
