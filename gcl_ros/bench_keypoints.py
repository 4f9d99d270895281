"""`python -m gcl_ros.bench_keypoints BAG`: recall against key points kept, in bf16 and int8.

The source is described with so many key points and registered to the raw target. int8 goes
through the message that `describer` sends; bf16 takes 70 bytes a key point where it takes 40.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from sensor_msgs.msg import PointCloud2, PointField

from gcl_core.config import load_config
from gcl_core.errors import bad_input_exits
from gcl_core.evaluation import metrics
from gcl_core.evaluation.predict import Method, Prediction
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import Features, PointCloud
from gcl_ros.bag import pair_list_label, read_encounters
from gcl_ros.bag_evaluation import offline
from gcl_ros.exchange import Exchange
from gcl_ros.feature_cloud import Described, describe, fill_feature_cloud, selected
from gcl_ros.recent import Recent
from gcl_ros.report import write_report
from gcl_ros.views import Scan, scan_of

COUNTS = (250, 500, 1000, 2000, 5000)
BYTES = {'int8': 40, 'bf16': 72}  # of a key point: four 16-bit numbers, 32 values


class Bench:
    """Registers described sources to raw targets; describes each scan once for all methods.

    The seconds of a method are therefore those of what it adds.
    """

    def __init__(self, config: RegistrarConfig) -> None:
        self.exchange = Exchange(Registrar(config))
        self._scans: Recent[Scan] = Recent(2)
        self._features: Recent[Described] = Recent(1)

    def methods(self) -> dict[str, Method]:
        """The raw cloud, and every count in both forms."""
        found: dict[str, Method] = {'raw': self.raw}
        for count in COUNTS:
            found[f'{count} int8'] = partial(self.in_int8, count)
            found[f'{count} bf16'] = partial(self.in_bf16, count)
        return found

    def raw(self, source: PointCloud, target: PointCloud) -> np.ndarray | None:
        """Register two raw clouds."""
        return self._registered(self._scan(source), target)

    def in_int8(self, keypoints: int, source: PointCloud, target: PointCloud) -> np.ndarray | None:
        """Send the source through the message that `describer` publishes."""
        message = PointCloud2()
        fill_feature_cloud(
            message, self._described(source), self.exchange.weights, keypoints, PointField
        )
        return self._registered(self.exchange.read(message), target)

    def in_bf16(self, keypoints: int, source: PointCloud, target: PointCloud) -> np.ndarray | None:
        """Round the descriptors to bfloat16."""
        described = self._described(source)
        kept = selected(described.headings[0], keypoints)
        rounded = Features(kept.points, kept.descriptors.to(torch.bfloat16).float())
        return self._registered(scan_of(Described([rounded], described.yaws)), target)

    def _registered(self, source: Scan, target: PointCloud) -> np.ndarray | None:
        result = self.exchange.register(source=source, target=self._scan(target)).result
        return result.T_target_source if result.accepted else None

    def _scan(self, cloud: PointCloud) -> Scan:
        return self._scans.get((cloud,), lambda: self.exchange.raw(cloud))

    def _described(self, cloud: PointCloud) -> Described:
        model = self.exchange.registrar.model
        return self._features.get((cloud,), lambda: describe(model, cloud, 1))


@dataclass(frozen=True)
class Point:
    """Recall of one method.

    Attributes:
        form: `raw`, `int8` or `bf16`.
        keypoints: kept; None of the raw cloud.
        bytes: of a scan; None of the raw cloud, whose points differ.
        pairs: that were tried.
        right: registered within 2 m and 5 degrees.
        wrong: transforms given that are not.
        recall: share that is right, and the ends of its 95 % Wilson interval.
    """

    form: str
    keypoints: int | None
    bytes: int | None
    pairs: int
    right: int
    wrong: int
    recall: tuple[float, float, float]


def point(predictions: list[Prediction], form: str, keypoints: int | None = None) -> Point:
    """Count one method's predictions."""
    name = form if keypoints is None else f'{keypoints} {form}'
    own = [p for p in predictions if p.method == name]
    right = sum(metrics.registered(p.T_estimated, p.T_true, metrics.LOOSE) for p in own)
    wrong = sum(p.T_estimated is not None for p in own) - right
    size = None if keypoints is None else keypoints * BYTES[form]
    recall = (right / len(own), *metrics.wilson(right, len(own)))
    return Point(form, keypoints, size, len(own), right, wrong, recall)


def draw(path: Path, points: list[Point]) -> None:
    """Draw loose recall with its 95 % Wilson interval against the bytes of a scan."""
    from matplotlib.figure import Figure

    axes = (figure := Figure(figsize=(8, 5))).add_subplot()
    for form in BYTES:
        own = [p for p in points if p.form == form]
        middle, low, high = 100 * np.array([p.recall for p in own]).T
        bars = np.maximum([middle - low, high - middle], 0)
        kilobytes = [p.bytes / 1000 for p in own if p.bytes]
        axes.errorbar(kilobytes, middle, bars, marker='o', capsize=3, label=form)
    raw = next(p for p in points if p.form == 'raw')
    axes.axhline(100 * raw.recall[0], color='grey', ls='--', label='raw cloud')
    axes.set(xscale='log', xlabel='kB a scan', ylabel='loose recall (2 m, 5°), %', ylim=(0, 102))
    axes.legend()
    figure.savefig(path, dpi=110, bbox_inches='tight')


def run(bag: Path, out: Path, config: RegistrarConfig) -> None:
    """Evaluate every count in both forms; write the report, `recall_by_kilobytes` png and json."""
    out.mkdir(parents=True, exist_ok=True)
    bench = Bench(config)
    encounters = list(read_encounters(bag))
    predictions = offline(bag, encounters, bench.methods())
    stamps = [e.stamp for e in encounters]
    print(write_report(out, pair_list_label(bag), predictions, stamps, {'counts': COUNTS}))
    points = [point(predictions, 'raw')]
    points += [point(predictions, form, count) for form in BYTES for count in COUNTS]
    content = {'pairs': pair_list_label(bag), 'curve': [asdict(p) for p in points]}
    (out / 'recall_by_kilobytes.json').write_text(json.dumps(content, indent=1) + '\n')
    draw(out / 'recall_by_kilobytes.png', points)


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(prog='bench_keypoints', description=__doc__)
    parser.add_argument('bag', type=Path, help='as `gcl bag` writes it')
    parser.add_argument('--out', type=Path, required=True, help='folder for tables and the plot')
    parser.add_argument('--config', type=Path, help='YAML of RegistrarConfig')
    o = parser.parse_args()
    with bad_input_exits('bench_keypoints'):
        config = load_config(RegistrarConfig, o.config) if o.config else RegistrarConfig()
        run(o.bag, o.out, config)


if __name__ == '__main__':
    main()
