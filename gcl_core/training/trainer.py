"""One trainer for every backbone, loss and source of scans."""

from __future__ import annotations

import ctypes
import json
import math
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch.utils.data import DataLoader
from tqdm import tqdm

from gcl_core.data.groups import find_groups, sample_groups
from gcl_core.losses.contrast import group_contrast
from gcl_core.losses.finest import finest
from gcl_core.losses.hardest_negative import hardest_negative
from gcl_core.losses.positive import positive_variance
from gcl_core.models.resunet import ResUNet, ResUNetConfig
from gcl_core.training import checkpoint
from gcl_core.training.samples import Sample, SampleConfig, SampleStream
from gcl_core.types import PositiveGroups


@dataclass(frozen=True)
class LossConfig:
    """Weights of the losses.

    Attributes:
        contrast: weight of the contrastive softmax that warms up, and stays.
        gcl_from: fraction of the run after which the paper's losses begin to rise to full weight.
        variance: weight of L_PV.
        finest: weight of L_F.
        negative: weight of L_HN.
        squared: the squared form of the public code instead of the paper's.
        groups: groups drawn for a step.
        radius: of a positive group, metres.
    """

    contrast: float = 1.0
    gcl_from: float = 0.5
    variance: float = 1.0
    finest: float = 1.0
    negative: float = 1.0
    squared: bool = True
    groups: int = 1024
    radius: float = 0.45


@dataclass(frozen=True)
class TrainConfig:
    """Everything a run depends on.

    Attributes:
        steps: optimiser steps of the whole run.
        learning_rate: peak of the one-cycle cosine.
        warmup: steps of linear warm-up.
        weight_decay: of AdamW.
        clip: largest gradient norm.
        bf16: compute in bfloat16.
        seed: of worlds, groups and initial weights.
        save_every: steps between checkpoints.
    """

    network: ResUNetConfig = field(default_factory=ResUNetConfig)
    samples: SampleConfig = field(default_factory=SampleConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    steps: int = 2000
    learning_rate: float = 4e-3
    warmup: int = 30
    weight_decay: float = 1e-4
    clip: float = 5.0
    bf16: bool = True
    seed: int = 1
    save_every: int = 50


def keep_freed_memory() -> None:
    """Ask glibc not to hand big buffers back at every free; page faults cost a third of a step."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, 'mallopt'):
        trim_threshold, mmap_max = -1, -4
        libc.mallopt(mmap_max, 0)
        libc.mallopt(trim_threshold, 2**31 - 1)


def _leave_cores_to_the_network(worker: int) -> None:
    torch.set_num_threads(1)


def gcl_loss(
    features: torch.Tensor, groups: PositiveGroups, config: LossConfig, ramp: float, seed: int
) -> tuple[torch.Tensor, dict[str, float]]:
    """Combine the losses: contrast + ramp x (L_PV + L_F + L_HN); return total and parts."""
    generator = torch.Generator().manual_seed(seed)
    drawn = sample_groups(groups, config.groups, generator)
    parts = {'contrast': config.contrast * group_contrast(features, drawn)}
    if ramp > 0:
        squared = config.squared
        negative = hardest_negative(features, drawn, generator=generator, squared=squared)
        parts['variance'] = (
            ramp * config.variance * positive_variance(features, drawn, squared=squared)
        )
        parts['finest'] = ramp * config.finest * finest(features, drawn, squared=squared)
        parts['negative'] = ramp * config.negative * negative
    total = torch.stack(list(parts.values())).sum()
    return total, {name: value.item() for name, value in parts.items()}


class Trainer:
    """Runs, logs and resumes one training.

    Args:
        config: see `TrainConfig`.
        folder: checkpoint and log; a checkpoint found there is resumed.
    """

    def __init__(self, config: TrainConfig, folder: Path) -> None:
        self.config, self.folder = config, folder
        folder.mkdir(parents=True, exist_ok=True)
        torch.manual_seed(config.seed)
        self.model = ResUNet(config.network)
        self.model.dtype = torch.bfloat16 if config.bf16 else torch.float32
        self.optimizer = torch.optim.AdamW(
            self.model.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self.step = 0
        if self._checkpoint.exists():
            self.step = checkpoint.load(self._checkpoint, self.model, self.optimizer)

    @property
    def _checkpoint(self) -> Path:
        return self.folder / 'checkpoint.safetensors'

    def learning_rate(self, step: int) -> float:
        """Linear warm-up, then half a cosine down to a hundredth."""
        config = self.config
        if step < config.warmup:
            return config.learning_rate * (step + 1) / config.warmup
        progress = (step - config.warmup) / max(1, config.steps - config.warmup)
        return config.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * progress)))

    def run(self) -> None:
        """Train to the last step."""
        keep_freed_memory()
        config = self.config
        stream = SampleStream(config.samples, config.network, config.seed, self.step, config.steps)
        loader = DataLoader(
            stream,
            batch_size=None,
            num_workers=1,
            multiprocessing_context='spawn',
            worker_init_fn=_leave_cores_to_the_network,
        )
        bar = tqdm(loader, total=config.steps, initial=self.step, unit='step', mininterval=5)
        with (self.folder / 'log.jsonl').open('a') as log:
            for sample in bar:
                began = time.perf_counter()
                row = self.train_step(sample)
                row['seconds'] = round(time.perf_counter() - began, 3)
                log.write(json.dumps(row) + '\n')
                log.flush()
                bar.set_postfix(loss=f'{row["loss"]:.3f}', top1=f'{row["top1"]:.3f}')
                if self.step % config.save_every == 0 or self.step == config.steps:
                    self.save()

    def save(self) -> None:
        """Write the checkpoint."""
        checkpoint.save(
            self._checkpoint, self.model, self.optimizer, self.step, asdict(self.config)
        )

    def train_step(self, sample: Sample) -> dict[str, float]:
        """Take one optimiser step; return what belongs in the log."""
        config = self.config
        rate = self.learning_rate(self.step)
        for parameters in self.optimizer.param_groups:
            parameters['lr'] = rate
        self.model.train()
        points, features, splits = self.model(sample.voxels)
        groups = find_groups(points, splits, sample.T_centre_scan, radius=config.loss.radius)
        progress = self.step / config.steps
        start = config.loss.gcl_from
        ramp = min(1.0, max(0.0, (progress - start) / max(1e-6, 0.5 * (1 - start))))
        loss, parts = gcl_loss(
            features, groups, config.loss, ramp, seed=config.seed * 1_000_003 + self.step
        )
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.model.parameters(), config.clip)
        self.optimizer.step()
        self.step += 1
        return {
            'step': self.step,
            'loss': loss.item(),
            **parts,
            'top1': top1(features.detach(), groups, splits),
            'grouped': len(groups) / max(1, splits[1]),
            'lr': rate,
            'gradient': float(norm),
        }


def top1(
    features: torch.Tensor, groups: PositiveGroups, splits: tuple[int, ...], queries: int = 256
) -> float:
    """Share of centre points whose nearest feature in a neighbour scan is of their group."""
    has_far = groups.offsets[1:] - 1  # last member: of the last scan the group has a point in
    rows = torch.linspace(0, len(groups) - 1, min(queries, len(groups))).long()
    source = groups.member[groups.offsets[:-1][rows]]
    target = groups.member[has_far[rows]]
    hits = 0
    for scan in range(1, len(splits) - 1):
        inside = (target >= splits[scan]) & (target < splits[scan + 1])
        candidates = features[splits[scan] : splits[scan + 1]]
        nearest = (features[source[inside]] @ candidates.t()).argmax(1) + splits[scan]
        hits += int((nearest == target[inside]).sum())
    return hits / max(1, len(rows))
