"""`python -m gcl_ros.bench_keypoints BAG`: recall against key points kept, in bf16 and int8.

The source is described with so many key points and registered to the raw target. int8 goes
through the message that `describer` sends; bf16 takes 70 bytes a key point where it takes 38.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import torch

from gcl_core.config import load_config
from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_core.evaluation.predict import Method, Prediction
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import Features, PointCloud
from gcl_ros.bag import pair_list_label, read_encounters
from gcl_ros.evaluate_bag import described, offline, raw
from gcl_ros.exchange import Exchange
from gcl_ros.feature_cloud import selected
from gcl_ros.report import write_report
from gcl_ros.views import Scan

COUNTS = (250, 500, 1000, 2000, 5000)
BYTES = {'int8': 38, 'bf16': 70}  # of a key point: three 16-bit coordinates, 32 values


def in_bf16(exchange: Exchange, keypoints: int) -> Method:
    """Registers a source described with so many key points, rounded to bfloat16."""

    def method(source: PointCloud, target: PointCloud) -> np.ndarray | None:
        kept = selected(exchange.registrar.model.describe([source])[0], keypoints)
        rounded = Features(kept.points, kept.descriptors.to(torch.bfloat16).float())
        scan = Scan(PointCloud(kept.points.numpy()), (rounded,))
        result = exchange.register(source=scan, target=Scan(target)).result
        return result.T_target_source if result.accepted else None

    return method


def draw(path: Path, predictions: list[Prediction]) -> None:
    """Draw loose recall with its 95 % Wilson interval against the bytes of a scan."""
    from matplotlib.figure import Figure

    axes = (figure := Figure(figsize=(8, 5))).add_subplot()
    for kind, size in BYTES.items():
        shares = [_recall(predictions, f'{count} {kind}') for count in COUNTS]
        middle, low, high = 100 * np.array(shares).T
        kilobytes = [count * size / 1000 for count in COUNTS]
        bars = np.maximum([middle - low, high - middle], 0)
        axes.errorbar(kilobytes, middle, bars, marker='o', capsize=3, label=kind)
    axes.axhline(100 * _recall(predictions, 'raw')[0], color='grey', ls='--', label='raw cloud')
    axes.set(xscale='log', xlabel='kB a scan', ylabel='loose recall (2 m, 5°), %', ylim=(0, 102))
    axes.legend()
    figure.savefig(path, dpi=110, bbox_inches='tight')


def _recall(predictions: list[Prediction], method: str) -> tuple[float, float, float]:
    own = [p for p in predictions if p.method == method]
    right = sum(metrics.registered(p.T_estimated, p.T_true, metrics.LOOSE) for p in own)
    return right / len(own), *metrics.wilson(right, len(own))


def run(bag: Path, out: Path, config: RegistrarConfig) -> None:
    """Evaluate every count in both forms; write the report and `recall_by_kilobytes.png`."""
    out.mkdir(parents=True, exist_ok=True)
    exchange = Exchange(Registrar(config))
    methods = {'raw': raw(exchange)}
    for count in COUNTS:
        methods[f'{count} int8'] = described(exchange, count)
        methods[f'{count} bf16'] = in_bf16(exchange, count)
    encounters = list(read_encounters(bag))
    predictions = offline(bag, encounters, methods)
    stamps = [e.stamp for e in encounters]
    print(write_report(out, pair_list_label(bag), predictions, stamps, {'counts': COUNTS}))
    draw(out / 'recall_by_kilobytes.png', predictions)


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(prog='bench_keypoints', description=__doc__)
    parser.add_argument('bag', type=Path, help='as `gcl bag` writes it')
    parser.add_argument('--out', type=Path, required=True, help='folder for tables and the plot')
    parser.add_argument('--config', type=Path, help='YAML of RegistrarConfig')
    o = parser.parse_args()
    try:
        config = load_config(RegistrarConfig, o.config) if o.config else RegistrarConfig()
        run(o.bag, o.out, config)
    except GclError as error:
        print(f'bench_keypoints: {error}', file=sys.stderr)
        sys.exit(2)


if __name__ == '__main__':
    main()
