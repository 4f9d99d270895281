"""Both backbones, scan by scan: data preparation and inference, as the paper splits its time.

    python -m gcl_core.bench.backbones --out bench/backbones.json

Processor time of one thread, so that other work on the machine does not count. The weights are
untrained, which does not change the time.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gcl_core.bench.measure import milliseconds
from gcl_core.config import load_config
from gcl_core.data.formats import open_sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import bad_input_exits
from gcl_core.models.kpconv_resunet import KPConvConfig
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.models.zoo import NetworkConfig, build
from gcl_core.ops.precision import best_dtype
from gcl_core.provenance import provenance_for
from gcl_core.training.recipe import TrainConfig
from gcl_core.types import PointCloud

SEED = 900  # of the street; training takes other worlds
RECIPES = Path(__file__).parents[2] / 'config'
PAPER: dict[str, NetworkConfig] = {
    'conv, paper': ResUNetConfig(),
    'kpconv, paper': KPConvConfig(),
}


def main() -> None:
    """Measure every network, print a table, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('bench/backbones.json'))
    parser.add_argument('--data', type=Path, help='recorded drives; default: a simulated street')
    parser.add_argument('--sequence', help='which of the drives')
    parser.add_argument('--scans', type=int, default=3, help='how many, spread over the drive')
    parser.add_argument('--threads', type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    with bad_input_exits('backbones'):
        here = provenance_for(options.out)
    clouds = scans(options.data, options.sequence, options.scans)
    networks = {
        name: load_config(TrainConfig, RECIPES / f'train_{name}.yaml').network
        for name in ('conv', 'kpconv')
    }
    figures: dict[str, Any] = {name: split(c, clouds) for name, c in (networks | PAPER).items()}
    print('| network | weights, M | points | data, ms | inference, ms |\n|---|---|---|---|---|')
    for name, row in figures.items():
        print(
            f'| {name} | {row["parameters_m"]:.2f} | {row["points"]:.0f} | '
            f'{row["data_ms"]:.0f} | {row["inference_ms"]:.0f} |'
        )
    figures |= here | {'source': str(options.data or 'simulated')}
    options.out.write_text(json.dumps(figures, indent=2) + '\n')


def scans(data: Path | None, sequence: str | None, count: int) -> list[PointCloud]:
    """Scans spread over a drive."""
    drive = open_sequence(data, sequence) if data else SimulatedSequence(SEED)
    return [drive.scan(int(i)) for i in np.linspace(0, len(drive) - 1, count + 2)[1:-1]]


def split(config: NetworkConfig, clouds: list[PointCloud]) -> dict[str, float]:
    """Mean processor time a scan of voxels with neighbours, and of the network."""
    torch.manual_seed(0)
    model = build(config).eval()
    model.dtype = best_dtype()
    processor_ms = partial(milliseconds, repeats=5, clock=time.process_time)
    data, inference, points = [], [], []
    with torch.inference_mode():
        for cloud in clouds:
            data.append(processor_ms(lambda c=cloud: model.prepare(model.voxelize([c]))))
            inputs = model.prepare(model.voxelize([cloud]))
            inference.append(processor_ms(lambda i=inputs: model(i)))
            points.append(len(model(inputs)[0]))
    parameters = sum(p.numel() for p in model.parameters())
    return {
        'parameters_m': parameters / 1e6,
        'points': float(np.mean(points)),
        'data_ms': float(np.mean(data)),
        'inference_ms': float(np.mean(inference)),
    }


if __name__ == '__main__':
    main()
