"""Recall on a bag, through the node or offline, and a peer's.

Offline, the same registrar works on the same clouds without DDS in between; `--compact` then also
on the source as `sender` sends it.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rclpy.executors import ExternalShutdownException

from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.config import load_config
from gcl_core.data.pairs import BINS, Pair
from gcl_core.errors import GclError
from gcl_core.evaluation.peers import PEERS
from gcl_core.evaluation.predict import Method, Prediction, timed
from gcl_core.evaluation.score import score
from gcl_core.progress import progress
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.to_json import to_json
from gcl_core.types import PointCloud
from gcl_ros.bag import Encounter, pair_list_label, read_encounters
from gcl_ros.exchange import Exchange
from gcl_ros.report import write_report
from gcl_ros.session import through_node
from gcl_ros.views import Scan


def _prediction(
    method: str, bag: Path, number: int, T_true: np.ndarray, T: np.ndarray | None, seconds: float
) -> Prediction:
    distance = float(np.linalg.norm(T_true[:3, 3]))
    rounded = round(distance, 6)
    bin_ = next((b for b in BINS if b[0] <= rounded < b[1]), (math.floor(rounded), 999))
    pair = Pair(number, number, distance, bin_)
    return Prediction(method, bag.name, pair, 0.0, T_true, T, seconds)


@contextmanager
def _stopped() -> Iterator[None]:
    """ROS ends a wait in its own way when it is told to stop."""
    try:
        yield
    except ExternalShutdownException:
        raise KeyboardInterrupt from None


def live(
    bag: Path, out: Path, encounters: list[Encounter], rate: float, settings: list[str]
) -> list[Prediction]:
    """Replay the bag through the node, both processes of their own.

    Args:
        bag: as `gcl bag` writes it.
        out: for logs.
        encounters: of the bag.
        rate: bag seconds a wall second.
        settings: `NAME:=VALUE` for the node.
    """
    with progress(total=len(encounters), unit='pair', desc='node') as bar, _stopped():
        rows = through_node(
            bag,
            out,
            expected=len(encounters),
            rate=rate,
            node_arguments=[part for setting in settings for part in ('-p', setting)],
            on_estimate=lambda row: bar.update(),
        )
    if len(rows) != len(encounters):
        raise GclError(f'{len(rows)} of {len(encounters)} pairs arrived; see the logs in {out}')
    return [
        _prediction('GCL-ROS node', bag, i, row.T_true, row.T_estimated, row.latency)
        for i, row in enumerate(rows)
    ]


def offline(
    bag: Path, encounters: list[Encounter], methods: dict[str, Method]
) -> list[Prediction]:
    """Run every method on every pair, in this process."""
    predictions = []
    for i, e in enumerate(progress(encounters, unit='pair', desc=', '.join(methods))):
        for name, method in methods.items():
            o = timed(name, method, e.source, e.target)
            T, truth = o.T_target_source, e.T_target_source
            predictions.append(_prediction(name, bag, i, truth, T, o.seconds))
    return predictions


def raw(exchange: Exchange) -> Method:
    """Registers two raw clouds."""

    def method(source: PointCloud, target: PointCloud) -> np.ndarray | None:
        result = exchange.register(source=Scan(source), target=Scan(target)).result
        return result.T_target_source if result.accepted else None

    return method


def compact(exchange: Exchange, config: CompactConfig) -> Method:
    """Registers a source as it arrives from a `sender` to a raw target."""
    register = raw(exchange)

    def method(source: PointCloud, target: PointCloud) -> np.ndarray | None:
        return register(decode(encode(source, config)), target)

    return method


def run(options: argparse.Namespace) -> str:
    """Evaluate, write everything; return the table, or JSON."""
    bag, out = options.bag, options.out
    direct = bool(options.offline or options.compact)
    sent = [CompactConfig(voxel_size=size) for size in options.compact]
    _check(options, direct)
    encounters = list(read_encounters(bag))
    if not encounters:
        raise GclError(f'bag {bag} holds no pair; write it with gcl bag')
    methods = {name: PEERS[name]() for name in options.peers}
    predictions = []
    config = load_config(RegistrarConfig, options.config) if options.config else RegistrarConfig()
    out.mkdir(parents=True, exist_ok=True)
    if direct:
        exchange = Exchange(Registrar(config))
        ours: dict[str, Method] = {'GCL-ROS': raw(exchange)}
        for how in sent:
            ours[f'GCL-ROS, compact {how.voxel_size:g} m'] = compact(exchange, how)
        methods = ours | methods
    else:
        predictions = live(bag, out, encounters, options.rate, options.set)
    if methods:
        predictions += offline(bag, encounters, methods)
    record = {key: str(value) for key, value in vars(options).items()}
    stamps = [e.stamp for e in encounters]
    label = pair_list_label(bag)
    table = write_report(out, label, predictions, stamps, record)
    rows = {'pairs': label, 'settings': record, 'rows': score(predictions)}
    return to_json(rows) if options.json else table


def _check(options: argparse.Namespace, direct: bool) -> None:
    """Refuse what would be ignored."""
    if direct and options.set:
        raise GclError(f'--set {options.set[0]} is for the node; offline give --config YAML')
    if options.config and not direct:
        raise GclError(f'--config {options.config} is for --offline; give the node --set')
