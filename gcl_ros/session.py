"""A bag through the node: `registrar` and `replay` as processes, their transforms collected."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from gcl_core.errors import GclError
from gcl_ros.bag import TRUTH
from gcl_ros.conversions import matrix, seconds
from gcl_ros.startup import running_ros
from gcl_ros.transport import keep_local

LAST_PAIR = 15.0  # seconds that the node has for the last pair after the bag has ended


@dataclass
class Row:
    """What is known of one pair so far.

    Attributes:
        T_true: true `T_target_source`, from the bag.
        heard: when the truth came in, on the monotonic clock, seconds.
        T_estimated: None while, or where, the node published nothing.
        latency: from the clouds' publication to the transform's arrival, seconds.
    """

    T_true: np.ndarray
    heard: float
    T_estimated: np.ndarray | None = None
    latency: float = float('nan')


class Listener(Node):
    """Holds estimated against true transforms.

    Attributes:
        rows: by their stamps.
        problem: why the node cannot work; empty where nothing is wrong with it.
    """

    def __init__(self, on_estimate: Callable[[Row], None]) -> None:
        super().__init__('listener')
        self.rows: dict[float, Row] = {}
        self.problem = ''
        self._on_estimate = on_estimate
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(TransformStamped, TRUTH, self._truth, latched)
        self.create_subscription(TransformStamped, '/registrar/transform', self._estimate, 10)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 10)

    def _diagnosed(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'registrar' and status.message.startswith('unconfigured: '):
                self.problem = status.message

    def _truth(self, message: TransformStamped) -> None:
        stamp = seconds(message.header.stamp)
        self.rows[stamp] = Row(matrix(message.transform), time.monotonic())

    def _estimate(self, message: TransformStamped) -> None:
        row = self.rows.get(seconds(message.header.stamp))
        if row is not None:
            row.T_estimated = matrix(message.transform)
            row.latency = time.monotonic() - row.heard
            self._on_estimate(row)


@contextmanager
def process(
    module: str,
    arguments: Sequence[str],
    folder: Path,
    *,
    name: str = '',
    before: Sequence[str] = (),
) -> Iterator[subprocess.Popen[Any]]:
    """Run a module of this package, `before` leading its command line.

    Its output goes to `folder/name.log`, by default its own name.
    """
    with (folder / f'{name or module}.log').open('w') as log:
        command = [*before, sys.executable, '-m', f'gcl_ros.{module}', *arguments]
        running = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            yield running
        finally:
            running.terminate()
            running.wait(timeout=30)


def through_node(
    bag: Path,
    folder: Path,
    *,
    expected: int,
    rate: float = 1.0,
    node_arguments: Sequence[str] = (),
    on_estimate: Callable[[Row], None] = lambda row: None,
) -> list[Row]:
    """Replay a bag through a registrar; return a row for each pair, in order of stamps.

    Args:
        bag: written by `gcl bag`.
        folder: for the processes' logs.
        expected: pairs in the bag.
        rate: bag seconds a wall second; pairs that come faster than the node works are dropped.
        node_arguments: after `--ros-args`.
        on_estimate: called with each row as its transform arrives.

    Raises:
        GclError: the node cannot work with these parameters, or has ended.
    """
    keep_local()
    ros = ['--ros-args', *node_arguments] if node_arguments else []
    replay = [str(bag), '--rate', str(rate)]
    with running_ros():
        listener = Listener(on_estimate)
        with (
            process('registrar', ros, folder) as registrar,
            process('replay', replay, folder) as player,
        ):
            for _ in _until_done(listener, player, expected):
                if listener.problem or registrar.poll() is not None:
                    reason = listener.problem or f'it ended, exit code {registrar.returncode}'
                    raise GclError(
                        f'no transform from the node: {reason}; see its log in {folder}'
                    )
        listener.destroy_node()
    return [listener.rows[stamp] for stamp in sorted(listener.rows)]


def _until_done(
    listener: Listener, player: subprocess.Popen[Any], expected: int
) -> Iterator[None]:
    """Listen until every pair is answered, or the bag has ended and the last had its time."""
    until = float('inf')
    while time.monotonic() < until:
        rclpy.spin_once(listener, timeout_sec=0.2)
        yield
        answered = sum(row.T_estimated is not None for row in listener.rows.values())
        if answered == expected:
            return
        if until == float('inf') and player.poll() is not None:
            until = time.monotonic() + LAST_PAIR
