"""Everything a training run depends on, as one strict YAML."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from gcl_core.errors import GclError
from gcl_core.losses.combined import LossConfig
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.models.zoo import NetworkConfig
from gcl_core.training.samples import SampleConfig

SEEDS = 700  # seed s takes worlds from s x 1,000,000 on; calibration and tests take the rest


@dataclass(frozen=True)
class OptimizerConfig:
    """How weights follow gradients.

    Attributes:
        name: `adamw`, or `sgd` with momentum 0.8 (public code).
        learning_rate: peak.
        warmup: steps of linear warm-up.
        cooldown: last fraction of the run over which the rate falls by half a cosine to a
            hundredth; 1 is one cosine over the whole run. Before it the rate is constant, so
            that a run can be prolonged and another cool-down taken from any checkpoint.
        weight_decay: decoupled for AdamW.
        clip: largest gradient norm.
        average: decay of the moving average of the weights that is validated and shipped; 0 for
            none.
    """

    name: Literal['adamw', 'sgd'] = 'adamw'
    learning_rate: float = 4e-3
    warmup: int = 30
    cooldown: float = 1.0
    weight_decay: float = 1e-4
    clip: float = 5.0
    average: float = 0.0

    def __post_init__(self) -> None:
        if self.name not in ('adamw', 'sgd'):
            raise GclError(f'optimizer.name is {self.name!r}; choose adamw or sgd')
        if not 0 < self.cooldown <= 1:
            raise GclError(f'optimizer.cooldown is {self.cooldown}; choose from ]0, 1]')
        if not 0 <= self.average < 1:
            raise GclError(f'optimizer.average is {self.average}; choose from [0, 1[')

    def rate(self, step: int, steps: int) -> float:
        """Learning rate of a step."""
        if step < self.warmup:
            return self.learning_rate * (step + 1) / self.warmup
        start = max(self.warmup, steps * (1 - self.cooldown))
        progress = min(1.0, max(0.0, (step - start) / max(1.0, steps - start)))
        return self.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * progress)))


@dataclass(frozen=True)
class GroupConfig:
    """Which positive groups of a sample are trained on.

    Attributes:
        count: groups drawn from a sample.
        radius: of a positive group, metres.
        per_scan: most members from one scan (public code: 5).
        finest: member that the finest loss takes as such: `nearest` to its sensor (public code)
            or `densest` (paper), see `gcl_core.data.groups.densest`.
    """

    count: int = 1024
    radius: float = 0.45
    per_scan: int = 1
    finest: Literal['nearest', 'densest'] = 'nearest'


@dataclass(frozen=True)
class TrainConfig:
    """A recipe.

    Attributes:
        network: its shape; `backbone` says which one.
        samples: which scans are trained together, and how they are turned and thinned.
        groups: which of their points are one spot.
        loss: weights of the losses.
        optimizer: how weights follow gradients.
        steps: optimiser steps of the whole run.
        batch: samples of a step, whose gradients are averaged; divided among the processes.
        bf16: compute in bfloat16, on processors that multiply it natively and on GPUs.
        seed: of worlds, groups and initial weights; 0 to 699.
        start: weights to begin from instead of new ones: a shipped name or a file, of the same
            network.
        save_every: steps between checkpoints.
        validate_every: steps between validations on held-out streets; 0 for none.
        workers: processes that cut samples.
    """

    network: NetworkConfig = field(default_factory=ResUNetConfig)
    samples: SampleConfig = field(default_factory=SampleConfig)
    groups: GroupConfig = field(default_factory=GroupConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)
    steps: int = 2000
    batch: int = 1
    bf16: bool = True
    seed: int = 1
    start: str = ''
    save_every: int = 50
    validate_every: int = 0
    workers: int = 1

    def __post_init__(self) -> None:
        for name in ('steps', 'batch', 'save_every', 'workers'):
            if getattr(self, name) < 1:
                raise GclError(f'{name} is {getattr(self, name)}; it must be at least 1')
        if not 0 <= self.seed < SEEDS:
            raise GclError(
                f'seed is {self.seed}; it must lie in 0 to {SEEDS - 1}: the worlds of larger ones '
                'are for calibration and tests'
            )
