"""The mean of a group shall lie at its finest feature: L_F (paper, equation 5)."""

from __future__ import annotations

import torch
from jaxtyping import Float

from gcl_core.losses.positive import group_means, norm
from gcl_core.types import PositiveGroups


def finest(
    features: Float[torch.Tensor, 'n d'],
    groups: PositiveGroups,
    *,
    margin: float = 0.2,
    squared: bool = False,
    blocked: bool = False,
) -> Float[torch.Tensor, '']:
    """L_F: distance from each group's mean to its finest member's feature.

    Args:
        features: unit descriptors of all scans stacked.
        groups: positive groups.
        margin: m_3 of the paper.
        squared: the form of the public code.
        blocked: BF of the paper's ablation: no gradient through the finest feature itself.
    """
    finest_features = features[groups.member[groups.finest]]
    if blocked:
        finest_features = finest_features.detach()
    difference = finest_features - group_means(features, groups)
    distance = difference.square().sum(1) if squared else norm(difference)
    return torch.relu(distance - margin).mean()
