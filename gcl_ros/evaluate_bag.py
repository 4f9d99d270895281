"""`python -m gcl_ros.evaluate_bag BAG`: recall of the node on a bag, beside a peer's."""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

from gcl_core.data.pairs import BINS, Pair
from gcl_core.errors import GclError
from gcl_core.evaluation import peers
from gcl_core.evaluation.predict import Prediction
from gcl_core.evaluation.score import markdown, score
from gcl_ros.bag import Encounter, pair_list_label, read_encounters
from gcl_ros.session import Row, through_node


def _pair(number: int, T_true: np.ndarray) -> Pair:
    distance = float(np.linalg.norm(T_true[:3, 3]))
    rounded = round(distance, 6)
    bin_ = next((b for b in BINS if b[0] <= rounded < b[1]), (math.floor(rounded), 999))
    return Pair(number, number, distance, bin_)


def _node_predictions(bag: Path, rows: list[Row]) -> list[Prediction]:
    return [
        Prediction(
            'GCL-ROS node',
            bag.name,
            _pair(i, row.T_true),
            0.0,
            row.T_true,
            row.T_estimated,
            row.latency,
        )
        for i, row in enumerate(rows)
    ]


def _peer_predictions(bag: Path, encounters: list[Encounter]) -> list[Prediction]:
    predictions = []
    for i, e in enumerate(tqdm(encounters, unit='pair', desc='FPFH + RANSAC')):
        began = time.perf_counter()
        T = peers.fpfh_ransac(e.source, e.target)
        taken = time.perf_counter() - began
        pair, truth = _pair(i, e.T_target_source), e.T_target_source
        predictions.append(Prediction('FPFH + RANSAC', bag.name, pair, 0.0, truth, T, taken))
    return predictions


def run(bag: Path, out: Path, *, rate: float, node_arguments: list[str]) -> None:
    """Replay through the node, run the peer on the same pairs, print a table."""
    out.mkdir(parents=True, exist_ok=True)
    encounters = list(read_encounters(bag))
    with tqdm(total=len(encounters), unit='pair', desc='node') as bar:
        rows = through_node(
            bag,
            out,
            expected=len(encounters),
            rate=rate,
            node_arguments=node_arguments,
            on_estimate=lambda row: bar.update(),
        )
    if len(rows) != len(encounters):
        raise GclError(f'{len(rows)} of {len(encounters)} pairs arrived; see the logs in {out}')
    predictions = _node_predictions(bag, rows) + _peer_predictions(bag, encounters)
    table = f'{pair_list_label(bag)}\n\n{markdown(score(predictions))}'
    (out / 'table.md').write_text(table + '\n')
    print(table)


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(prog='evaluate_bag', description=__doc__)
    parser.add_argument('bag', type=Path, help='as `gcl bag` writes it')
    parser.add_argument('--out', type=Path, required=True, help='folder for logs and table.md')
    parser.add_argument('--rate', type=float, default=0.2, help='bag seconds a wall second')
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME:=VALUE', help='parameter of the node'
    )
    o = parser.parse_args()
    try:
        node_arguments = [part for setting in o.set for part in ('-p', setting)]
        run(o.bag, o.out, rate=o.rate, node_arguments=node_arguments)
    except GclError as error:
        print(f'evaluate_bag: {error}', file=sys.stderr)
        sys.exit(2)


if __name__ == '__main__':
    main()
