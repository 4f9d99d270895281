"""`gcl train`: train on simulated streets; resumes where it was stopped."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gcl_core.config import load_config
from gcl_core.training.curves import training_curves


def add_parser(commands: Any) -> None:
    """Add the subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        'train',
        help='train an extractor',
        description='Train on simulated streets. Run again with the same folder to resume.',
        epilog='Example: gcl train --config config/train_conv.yaml --out runs/conv',
    )
    parser.add_argument('--config', type=Path, required=True, help='YAML of TrainConfig')
    parser.add_argument(
        '--set',
        nargs='+',
        default=[],
        metavar='KEY=VALUE',
        help='instead of what the YAML says: --set loss.pair=1 samples.phi=4',
    )
    parser.add_argument('--out', type=Path, required=True, help='checkpoint, log, curves, weights')
    parser.add_argument('--cache', type=Path, help='keep cut samples here, to use them again')
    parser.add_argument('--cache-gb', type=float, default=10.0, help='largest size of the cache')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Train, then write weights with their record and the curves."""
    from gcl_core.models.zoo import save_weights
    from gcl_core.training.distributed import processes
    from gcl_core.training.recipe import TrainConfig
    from gcl_core.training.trainer import Trainer

    config = load_config(TrainConfig, options.config, options.set)
    cache = (options.cache, options.cache_gb) if options.cache else None
    with processes() as own:
        trainer = Trainer(config, options.out, own, cache=cache)
        trainer.run()
        if not own.first:
            return 0
    data = f'{config.samples.data} {config.samples.drives}'
    record = {
        'recipe': asdict(config),
        'steps': trainer.step,
        'data': data if config.samples.data else 'simulated streets only',
    }
    save_weights(options.out / 'weights.safetensors', trainer.shipped, record)
    log = options.out / 'log.jsonl'
    training_curves(options.out / 'curves.png', {'run': log})
    print(f'wrote {options.out / "weights.safetensors"} and {options.out / "curves.png"}')
    return 0
