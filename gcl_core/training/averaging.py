"""A moving average of the weights: steadier than the last step's (Polyak and Juditsky, 1992)."""

from __future__ import annotations

import copy
from typing import TypeVar

import torch
from torch import nn

Model = TypeVar('Model', bound=nn.Module)


def averaged(model: Model) -> Model:
    """A copy to be followed up; it is never trained itself."""
    return copy.deepcopy(model).eval().requires_grad_(False)


@torch.no_grad()
def follow(average: nn.Module, model: nn.Module, decay: float, step: int) -> None:
    """Move the average's weights and statistics towards the model's.

    Args:
        average: from `averaged`.
        model: as trained.
        decay: share of the old average that stays; less at the start of a run.
        step: steps done.
    """
    stay = min(decay, (1 + step) / (10 + step))
    for old, new in zip(average.state_dict().values(), model.state_dict().values(), strict=True):
        if old.is_floating_point():
            old.lerp_(new, 1 - stay)
        else:
            old.copy_(new)
