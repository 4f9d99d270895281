"""The run itself: faults in time, looks at the node's memory."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from rclpy.executors import SingleThreadedExecutor

from gcl_core.errors import GclError
from gcl_core.progress import progress
from gcl_ros.soak.faults import Fault, active
from gcl_ros.soak.machine import Machine
from gcl_ros.soak.observer import Observer

WARM = 600.0  # seconds until the node is warm; half of a shorter run
FLAT = 0.05  # share by which the node's memory may grow or shrink after it is warm
LOADING = 600.0  # seconds for all processes to load
SAMPLE = 5.0  # seconds between looks at the memory


class Watch:
    """Brings the faults of a run in time, and looks at the node.

    Attributes:
        seconds: that the run has lasted.
        memory: of the node, MB, every `SAMPLE` seconds.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.memory: list[float] = []

    def run(
        self,
        observer: Observer,
        machine: Machine,
        faults: list[Fault],
        seconds: float,
        stop: threading.Event,
    ) -> None:
        """Watch until the time is up, the node is gone, or somebody wants an end."""
        executor = SingleThreadedExecutor()
        executor.add_node(observer)
        machine.vehicles()
        _wait(observer, machine, executor, stop)
        start = machine.begin()
        with progress(total=round(seconds), unit='s', desc='soak') as bar:
            while self.seconds < seconds and machine.node_alive and not stop.is_set():
                executor.spin_once(timeout_sec=0.1)
                observer.ask()
                machine.bring(active(faults, self.seconds))
                if self.seconds >= SAMPLE * len(self.memory):
                    self.memory.append(round(machine.node_mb(), 1))
                    bar.set_postfix(accepted=observer.counts['accepted'], mb=self.memory[-1])
                    bar.update(round(self.seconds) - bar.n)
                self.seconds = time.time() - start


def _wait(observer: Observer, machine: Machine, executor: Any, stop: threading.Event) -> None:
    """Wait until vehicles and node have found each other."""
    until = time.monotonic() + LOADING
    while not observer.everybody_there and machine.node_alive and not stop.is_set():
        executor.spin_once(timeout_sec=0.2)
        if time.monotonic() > until:
            raise GclError(
                f'no node and vehicles within {LOADING:g} s; see the logs in the folder'
            )


def in_short(memory: list[float]) -> dict[str, float]:
    """The node's memory at the start, once it is warm, and in the end; its peak."""
    if not memory:
        return {}
    warm = memory[_warm(memory)]
    return {'start': memory[0], 'warm': warm, 'end': memory[-1], 'peak': max(memory)}


def _warm(memory: list[float]) -> int:
    """From which look on the node is warm."""
    return min(len(memory) // 2, round(WARM / SAMPLE))


def memory_change(memory: list[float]) -> float:
    """Change from the first to the last third of the time in which the node is warm."""
    warm = memory[_warm(memory) :]
    third = len(warm) // 3
    if third == 0:
        return 0.0
    early, late = np.median(warm[:third]), np.median(warm[-third:])
    return round(float(late / early - 1), 4)
