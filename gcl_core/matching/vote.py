"""Which heading is the likeliest: a cheap look at how alike two scans are at each."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float

from gcl_core.matching.nearest import similarity_of_nearest
from gcl_core.types import Features, Heading

VOTERS = 800  # key points of the source, evenly among all
CANDIDATES = 2000  # key points of the target


def likeliest_first(
    headings: Sequence[Heading], target: Features, dtype: torch.dtype
) -> list[Heading]:
    """Order the headings of a source by how alike its key points are to the target's.

    Each of some key points votes for the headings at which its nearest neighbour in feature space
    is more alike than at the average heading, by the square of how much more.

    Args:
        headings: of one description, so that their key points are the same.
        target: features.
        dtype: in which descriptors are compared.
    """
    if not len(target) or not len(headings[0].features):
        return list(headings)
    candidates = _some(target.descriptors, CANDIDATES).to(dtype)
    nearest = torch.stack(
        [
            similarity_of_nearest(_some(h.features.descriptors, VOTERS).to(dtype), candidates)
            for h in headings
        ]
    )
    votes = (nearest - nearest.mean(0)).clamp(min=0).double().square().sum(1)
    return [headings[i] for i in votes.argsort(descending=True, stable=True).tolist()]


def _some(rows: Float[torch.Tensor, 'n d'], most: int) -> Float[torch.Tensor, 'm d']:
    return rows[torch.linspace(0, len(rows) - 1, min(len(rows), most)).long()]
