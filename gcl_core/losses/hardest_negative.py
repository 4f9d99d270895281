"""What does not belong together shall differ: L_HN (paper, equations 6 and 7)."""

from __future__ import annotations

import torch
from jaxtyping import Float

from gcl_core.types import PositiveGroups


def hardest_negative(
    features: Float[torch.Tensor, 'n d'],
    groups: PositiveGroups,
    *,
    generator: torch.Generator,
    margin: float = 1.4,
    candidates: int = 2048,
    squared: bool = False,
) -> Float[torch.Tensor, '']:
    """L_HN: distance of each member to the nearest feature of another group.

    Both sides are random subsets of `candidates` members (public code: 1,024). The paper averages
    over members within a group first; here every drawn member counts the same, as in public code.
    """
    group = groups.group
    anchor = torch.randperm(len(group), generator=generator)[:candidates]
    other = torch.randperm(len(group), generator=generator)[:candidates]
    similarity = features[groups.member[anchor]] @ features[groups.member[other]].t()
    own = group[anchor].unsqueeze(1) == group[other].unsqueeze(0)
    nearest = similarity.masked_fill(own, -2.0).max(1).values
    # Unit features: |a - b|^2 = 2 - 2 a.b
    distance = (2.0 - 2.0 * nearest).clamp(min=1e-8).sqrt()
    hinge = torch.relu(margin - distance)
    return hinge.square().mean() if squared else hinge.mean()
