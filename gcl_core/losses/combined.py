"""The sum of losses that a recipe asks for: L = sum of weight x term (paper, "Loss Designs")."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float

from gcl_core.errors import GclError
from gcl_core.losses.circle import circle
from gcl_core.losses.contrast import group_contrast
from gcl_core.losses.finest import finest
from gcl_core.losses.hardest_negative import hardest_negative
from gcl_core.losses.positive import positive_pair, positive_variance
from gcl_core.types import PositiveGroups

LOWEST_TEMPERATURE = 0.02  # e^(1 / T) times thousands of negatives is a float32


@dataclass(frozen=True)
class LossConfig:
    """Weights of the losses; a weight of 0 leaves the loss out.

    The paper's GCL+Conv is variance + finest + negative, its GCL+KPConv pair + finest + negative,
    FCGF pair + negative on groups of two. On nuScenes the paper weighs 0.7 / 0.7 / 1.

    Attributes:
        contrast: contrastive softmax; not in the paper, converges from scratch.
        pair: L_PP.
        variance: L_PV.
        finest: L_F.
        blocked_finest: BF, L_F without a gradient through the finest feature.
        circle: C, the circle loss on groups.
        negative: L_HN.
        gcl_from: fraction of the run after which all but the contrastive softmax begin to rise
            to full weight, which they reach half-way from there to the end; 0 with contrast 0
            is the paper.
        squared: the squared form of the public code instead of the paper's.
        temperature: of the contrastive softmax.
        safe_radius: groups whose spots are nearer are no negatives of each other in the
            contrastive softmax, metres.
    """

    contrast: float = 1.0
    pair: float = 0.0
    variance: float = 1.0
    finest: float = 1.0
    blocked_finest: float = 0.0
    circle: float = 0.0
    negative: float = 1.0
    gcl_from: float = 0.5
    squared: bool = True
    temperature: float = 0.1
    safe_radius: float = 1.2

    def __post_init__(self) -> None:
        weights = {name: getattr(self, name) for name in TERMS}
        if any(weight < 0 for weight in weights.values()) or not any(weights.values()):
            raise GclError(
                f'loss weights are {weights}; none may be negative, one must be positive'
            )
        if self.temperature < LOWEST_TEMPERATURE:
            raise GclError(
                f'loss.temperature is {self.temperature:g}; below {LOWEST_TEMPERATURE:g} the '
                'softmax overflows'
            )
        if not 0 < self.safe_radius < math.inf:
            raise GclError(f'loss.safe_radius is {self.safe_radius}; choose some metres')
        if self.contrast == 0 and self.gcl_from > 0:
            raise GclError(
                f'loss.gcl_from is {self.gcl_from:g} and loss.contrast 0, so that nothing is '
                'learnt before the other losses join; set gcl_from to 0'
            )

    def ramp(self, progress: float) -> float:
        """Factor of the losses that join later, at this fraction of the run."""
        if self.gcl_from == 0:
            return 1.0
        rise = 0.5 * (1 - self.gcl_from)
        return min(1.0, max(0.0, (progress - self.gcl_from) / max(1e-6, rise)))


def combined(
    features: Float[torch.Tensor, 'n d'],
    groups: PositiveGroups,
    config: LossConfig,
    *,
    progress: float,
    generator: torch.Generator,
) -> tuple[Float[torch.Tensor, ''], dict[str, float]]:
    """Return the weighted sum, and each part as it enters it.

    Args:
        features: unit descriptors of all scans stacked.
        groups: positive groups.
        config: the weights.
        progress: fraction of the run that is done.
        generator: of all that is drawn at random.
    """
    parts = {}
    for name in TERMS:
        weight = getattr(config, name) * (1.0 if name == 'contrast' else config.ramp(progress))
        if weight > 0:
            parts[name] = weight * TERMS[name](features, groups, config, generator)
    total = torch.stack(list(parts.values())).sum()
    return total, {name: part.item() for name, part in parts.items()}


TERMS: dict[
    str, Callable[[torch.Tensor, PositiveGroups, LossConfig, torch.Generator], torch.Tensor]
] = {
    'contrast': lambda f, g, c, _: group_contrast(
        f, g, temperature=c.temperature, safe_radius=c.safe_radius
    ),
    'pair': lambda f, g, c, r: positive_pair(f, g, generator=r, squared=c.squared),
    'variance': lambda f, g, c, _: positive_variance(f, g, squared=c.squared),
    'finest': lambda f, g, c, _: finest(f, g, squared=c.squared),
    'blocked_finest': lambda f, g, c, _: finest(f, g, squared=c.squared, blocked=True),
    'circle': lambda f, g, c, r: circle(f, g, generator=r),
    'negative': lambda f, g, c, r: hardest_negative(f, g, generator=r, squared=c.squared),
}
