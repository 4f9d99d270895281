"""Positives and negatives of every member in one smooth term: the circle loss on groups, C.

Sun et al., CVPR 2020, in the form of Predator (Huang et al., CVPR 2021): the further a pair is
from its optimum, the more it weighs. The paper's ablation tries it on positive groups.
"""

from __future__ import annotations

import torch
from jaxtyping import Float

from gcl_core.losses.positive import NORM_FLOOR
from gcl_core.types import PositiveGroups


def circle(
    features: Float[torch.Tensor, 'n d'],
    groups: PositiveGroups,
    *,
    generator: torch.Generator,
    positive_margin: float = 0.1,
    negative_margin: float = 1.4,
    log_scale: float = 16.0,
    safe_radius: float = 0.75,
    groups_drawn: int = 512,
) -> Float[torch.Tensor, '']:
    """Return the mean over all members of softplus(positives + negatives) / `log_scale`.

    Args:
        features: unit descriptors of all scans stacked.
        groups: positive groups.
        generator: draws the groups.
        positive_margin: distance that positives aim for.
        negative_margin: distance that negatives aim for.
        log_scale: sharpness of the soft maximum.
        safe_radius: groups whose spots are nearer than this are no negatives, metres.
        groups_drawn: groups that take part, for the square of their members is held in memory.
    """
    drawn = torch.randperm(len(groups), generator=generator)[:groups_drawn]
    kept = torch.isin(groups.group, drawn.to(groups.member.device))
    group = groups.group[kept]
    f = features[groups.member[kept]]
    distance = (2.0 - 2.0 * f @ f.t()).clamp(min=NORM_FLOOR).sqrt()
    same = group.unsqueeze(1) == group.unsqueeze(0)
    spot = groups.anchor[group].to(f.dtype)
    far = torch.cdist(spot, spot) > safe_radius
    same.fill_diagonal_(False)
    pull = (distance - positive_margin).relu()
    push = (negative_margin - distance).relu()
    # Each weight is the hinge itself, without gradient (self-paced weighting).
    positives = (log_scale * (distance - positive_margin) * pull.detach()).masked_fill(~same, -1e9)
    negatives = (log_scale * (negative_margin - distance) * push.detach()).masked_fill(~far, -1e9)
    both = positives.logsumexp(1) + negatives.logsumexp(1)
    counted = same.any(1) & far.any(1)
    return torch.nn.functional.softplus(both[counted]).mean() / log_scale
