"""How many neighbours KPConv keeps: counted once on simulated scans, written into the recipe.

    python -m gcl_core.training.neighbor_limits --config config/train_kpconv.yaml

The limits go into `network.limits`; the weights carry them, so that no run needs a data set.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import torch

from gcl_core.config import load_config
from gcl_core.errors import GclError, bad_input_exits
from gcl_core.models.kpconv_resunet import KPConvConfig, KPConvResUNet
from gcl_core.ops.neighbors import limit_of
from gcl_core.training.recipe import TrainConfig
from gcl_core.training.samples import SampleConfig, source_of
from gcl_core.types import PointCloud

KEEP = 0.8  # share of points that lose no neighbour; public code
SEED = 980_000_000  # of the streets; no training run and no validation reaches them
UNLIMITED = 1000


def calibrated(
    network: KPConvConfig, clouds: Iterable[PointCloud], keep: float = KEEP
) -> KPConvConfig:
    """Config with neighbour limits for these scans: the quantile `keep` of the counts by level.

    Args:
        network: whose grids and radius count; its own limits do not.
        clouds: typical scans, untouched by augmentation.
        keep: see `KEEP`.
    """
    model = KPConvResUNet(replace(network, width=2, limits=(UNLIMITED,) * network.levels))
    counts: list[list[torch.Tensor]] = [[] for _ in range(network.levels)]
    for cloud in clouds:
        pyramid = model.prepare(model.voxelize([cloud]))
        for level, table in enumerate(pyramid.same):
            counts[level].append((table < len(table)).sum(1))
    if not counts[0]:
        raise GclError('no scan to count neighbours on; give at least one')
    return replace(network, limits=tuple(limit_of(torch.cat(c), keep) for c in counts))


def scans(config: SampleConfig) -> Iterator[PointCloud]:
    """Scans as a recipe trains on them, without end."""
    number = 0
    while True:
        yield from source_of(config).group(number, seed=SEED).clouds
        number += 1


def main(arguments: Sequence[str] | None = None) -> None:
    """Count, and print what goes into the YAML."""
    parser = argparse.ArgumentParser(description='Calibrate the neighbour limits of KPConv.')
    parser.add_argument('--config', type=Path, required=True, help='YAML of TrainConfig')
    parser.add_argument('--scans', type=int, default=56, help='how many to count on')
    parser.add_argument('--keep', type=float, default=KEEP, help='share of untouched points')
    options = parser.parse_args(arguments)
    with bad_input_exits('neighbor_limits'):
        config = load_config(TrainConfig, options.config)
        if not isinstance(config.network, KPConvConfig):
            raise GclError(f'{options.config}: network.backbone is not kpconv')
        found = calibrated(
            config.network, islice(scans(config.samples), options.scans), options.keep
        )
    print(f'limits: {list(found.limits)}')


if __name__ == '__main__':
    main()
