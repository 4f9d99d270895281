"""`gcl train`: train on simulated streets or recorded drives; resumes where it was stopped."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from gcl_core.cli.outcome import Answer
from gcl_core.config import load_config
from gcl_core.models.zoo import save_weights
from gcl_core.training.curves import training_curves
from gcl_core.training.distributed import processes
from gcl_core.training.recipe import TrainConfig
from gcl_core.training.trainer import Trainer


def run(options: argparse.Namespace) -> Answer:
    """Train, then write weights with their record and the curves."""
    config = load_config(TrainConfig, options.config, options.set)
    if options.cache:
        options.cache.mkdir(parents=True, exist_ok=True)
    cache = (options.cache, options.cache_gb) if options.cache else None
    with processes() as own:
        trainer = Trainer(config, options.out, own, cache=cache)
        trainer.run()
        if not own.first:
            return Answer()
    data = f'{config.samples.data} {config.samples.drives}'
    record = {
        'recipe': asdict(config),
        'steps': trainer.step,
        'data': data if config.samples.data else 'simulated streets only',
    }
    if trainer.start_sha256:
        record['start_sha256'] = trainer.start_sha256
    save_weights(options.out / 'weights.safetensors', trainer.shipped, record)
    log = options.out / 'log.jsonl'
    training_curves(options.out / 'curves.png', {'run': log})
    return Answer(f'wrote {options.out}/weights.safetensors and curves.png')
