"""One trainer for every backbone, loss and source of scans."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torch.utils.data import DataLoader

from gcl_core.data.groups import densest, find_groups, sample_groups
from gcl_core.errors import GclError
from gcl_core.files import sha256
from gcl_core.losses.combined import combined
from gcl_core.models.backbone import Backbone
from gcl_core.models.zoo import build, load_weights, weights_file
from gcl_core.ops.memory import keep_freed_memory
from gcl_core.ops.precision import best_dtype
from gcl_core.progress import progress
from gcl_core.training import checkpoint
from gcl_core.training.averaging import averaged, follow
from gcl_core.training.distributed import Processes
from gcl_core.training.log import TrainingLog
from gcl_core.training.recipe import OptimizerConfig, TrainConfig
from gcl_core.training.sample import Sample
from gcl_core.training.samples import SampleStream, leave_cores_to_the_network
from gcl_core.training.validation import top1, validate


class Trainer:
    """Runs, logs and resumes one training.

    Args:
        config: see `TrainConfig`.
        folder: checkpoint and log; a checkpoint found there is resumed.
        processes: which process of how many this is.
        cache: folder for cut samples and its largest size in GB; for runs that share samples.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: Path,
        processes: Processes | None = None,
        *,
        cache: tuple[Path, float] | None = None,
    ) -> None:
        self.config, self.folder = config, folder
        self._cache = cache
        self.processes = processes or Processes()
        self._share = self.processes.share(config.batch)
        folder.mkdir(parents=True, exist_ok=True)
        torch.manual_seed(config.seed)
        resumed = self._checkpoint.exists()
        model = build(config.network) if resumed else begin(config)
        self.model = model.to(self.processes.device)
        on_gpu = self.processes.device.type != 'cpu'
        fastest = torch.bfloat16 if on_gpu else best_dtype()
        self.model.dtype = fastest if config.bf16 else torch.float32
        self.optimizer = optimizer(self.model, config.optimizer)
        self.average = averaged(self.model) if config.optimizer.average else None
        self.step, self.start_sha256 = 0, ''
        if resumed:
            held = checkpoint.load(self._checkpoint, self._state(), asdict(config))
            self.step, self.start_sha256 = held
        elif config.start:
            self.start_sha256 = sha256(weights_file(config.start))
        self._parallel = self.processes.parallel(self.model)

    @property
    def shipped(self) -> Backbone[Any, Any]:
        """The weights to validate and to keep: averaged ones where there are."""
        return self.average or self.model

    @property
    def _checkpoint(self) -> Path:
        return self.folder / 'checkpoint.safetensors'

    def _state(self) -> checkpoint.State:
        return checkpoint.State(self.model, self.optimizer, self.average)

    def run(self) -> None:
        """Train to the last step."""
        keep_freed_memory()
        bar = progress(
            total=self.config.steps,
            initial=self.step,
            unit='step',
            mininterval=5,
            hidden=not self.processes.first,
        )
        with TrainingLog(self.folder, self.step) if self.processes.first else nullcontext() as log:
            for samples in self._batches():
                row = self.train_step(samples)
                if self.config.validate_every and self.step % self.config.validate_every == 0:
                    row |= validate(self.shipped)
                if log:
                    log.write(row)
                    bar.set_postfix(loss=f'{row["loss"]:.3f}', top1=f'{row["top1"]:.3f}')
                    bar.update()
                if self.step % self.config.save_every == 0 or self.step == self.config.steps:
                    self.save()

    def _batches(self) -> Iterator[list[Sample[Any]]]:
        """This process's share of each step's samples, from the current step on."""
        config, processes = self.config, self.processes
        numbers = range(
            self.step * config.batch + processes.rank,
            config.steps * config.batch,
            processes.count,
        )
        last = config.steps * config.batch
        loader = DataLoader(
            SampleStream(
                config.samples, config.network, config.seed, numbers, last, cache=self._cache
            ),
            batch_size=None,
            num_workers=config.workers,
            multiprocessing_context='spawn',
            worker_init_fn=leave_cores_to_the_network,
        )
        samples: list[Sample[Any]] = []
        for sample in loader:
            samples.append(sample)
            if len(samples) == self._share:
                yield samples
                samples = []

    def save(self) -> None:
        """Write the checkpoint; the first process does it for all."""
        if self.processes.first:
            config = asdict(self.config)
            checkpoint.save(self._checkpoint, self._state(), self.step, config, self.start_sha256)

    def train_step(self, samples: Sequence[Sample[Any]]) -> dict[str, float]:
        """Take one optimiser step; return what belongs in the log."""
        began = time.perf_counter()
        rate = self.config.optimizer.rate(self.step, self.config.steps)
        for parameters in self.optimizer.param_groups:
            parameters['lr'] = rate
        self.model.train()
        self.optimizer.zero_grad(set_to_none=True)
        rows = []
        for place, sample in enumerate(samples):
            last = place == len(samples) - 1
            with self.processes.synchronised(self._parallel, last=last):
                rows.append(self._backward(sample, place))
        norm = nn.utils.clip_grad_norm_(self.model.parameters(), self.config.optimizer.clip)
        self.optimizer.step()
        if self.average:
            follow(self.average, self.model, self.config.optimizer.average, self.step)
        self.step += 1
        own = {name: sum(row[name] for row in rows) / len(rows) for name in rows[0]}
        return {
            'step': self.step,
            **self.processes.mean(own),
            'lr': rate,
            'gradient': float(norm),
            'seconds': round(time.perf_counter() - began, 3),
        }

    def _backward(self, sample: Sample[Any], place: int) -> dict[str, float]:
        """Add one sample's gradient, its share of the batch."""
        config, device = self.config, self.processes.device
        points, features, splits = self._parallel(sample.inputs.to(device))
        groups = find_groups(
            points.cpu(),
            splits,
            sample.T_centre_scan,
            radius=config.groups.radius,
            per_scan=config.groups.per_scan,
        )
        if config.groups.finest == 'densest':
            groups = densest(groups, points.cpu(), splits)
        number = self.step * config.batch + place * self.processes.count + self.processes.rank
        generator = torch.Generator().manual_seed(config.seed * 1_000_003 + number)
        drawn = sample_groups(groups, config.groups.count, generator).to(device)
        loss, parts = combined(
            features, drawn, config.loss, progress=self.step / config.steps, generator=generator
        )
        (loss / self._share).backward()
        return {
            'loss': loss.item(),
            **parts,
            'top1': top1(features.detach().cpu(), groups, splits),
            'grouped': len(groups) / max(1, splits[1]),
        }


def begin(config: TrainConfig) -> Backbone[Any, Any]:
    """Make the network of a recipe: new, or with the weights that it starts from.

    Raises:
        GclError: those weights cannot be read, or are of another network.
    """
    if not config.start:
        return build(config.network)
    model = load_weights(config.start)
    held, wanted = asdict(model.config), asdict(config.network)
    differing = [n for n in {**held, **wanted} if held.get(n) != wanted.get(n)]
    if 'backbone' in differing:  # two backbones share few of their settings
        differing = ['backbone']
    if differing:
        raise GclError(
            f'start is {config.start!r}, whose network has other {", ".join(differing)}; set '
            'network as in the record beside the weights, or start from nothing'
        )
    return model


def optimizer(model: nn.Module, config: OptimizerConfig) -> torch.optim.Optimizer:
    """Make the optimiser of a recipe."""
    rate, decay = config.learning_rate, config.weight_decay
    if config.name == 'sgd':
        return torch.optim.SGD(model.parameters(), lr=rate, momentum=0.8, weight_decay=decay)
    return torch.optim.AdamW(model.parameters(), lr=rate, weight_decay=decay)
