"""The processes of a run: node, publishers, competitors; killed, starved and cut off from disk."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from gcl_ros.soak.faults import Fault

BUSY = 'while True: pass'
FULL = 4096  # bytes that a file may have when the disk is full
PARAMETERS = {'max_pair_dt': 0.05, 'registrar.headings': 1, 'max_points': 400_000}
RECORDED = 120  # seconds for a recording without room to end, in the end


class Machine:
    """Starts the node and both vehicles; does to them what the schedule says.

    Args:
        bag: scenes.
        folder: for logs.
        seed: of the faults.
        seconds: how long the run is.

    Attributes:
        brought: how often each kind of fault was.
    """

    def __init__(self, bag: Path, folder: Path, seed: int, seconds: float) -> None:
        self._bag, self._folder, self._began = bag, folder, folder / 'began'
        self._began.unlink(missing_ok=True)
        times = {'seed': seed, 'began': self._began, 'seconds': seconds}
        self._times = [part for k, v in times.items() for part in (f'--{k}', str(v))]
        self._running: dict[str, subprocess.Popen[Any]] = {}
        self._recordings: list[subprocess.Popen[Any]] = []
        self._fault: Fault | None = None
        self.brought: Counter[str] = Counter()
        settings = [f'{name}:={value}' for name, value in PARAMETERS.items()]
        arguments = ['--ros-args', *(part for s in settings for part in ('-p', s))]
        self._start('node', ['-m', 'gcl_ros.registrar', *arguments])

    def _process(self, name: str, arguments: list[str]) -> subprocess.Popen[Any]:
        with (self._folder / f'{name.replace(" ", "_")}.log').open('a') as log:
            return subprocess.Popen([sys.executable, *arguments], stdout=log, stderr=log)

    def _start(self, name: str, arguments: list[str]) -> None:
        self._running[name] = self._process(name, arguments)

    def begin(self) -> float:
        """Let the vehicles send; seconds since the epoch."""
        now = time.time()
        whole = self._began.with_suffix('.part')
        whole.write_text(repr(now))
        whole.rename(self._began)
        return now

    def vehicles(self) -> None:
        """Start whichever vehicle is not running."""
        for side in ('source', 'target'):
            process = self._running.get(side)
            if process is None or process.poll() is not None:
                module = ['-m', 'gcl_ros.soak.publisher', side, str(self._bag)]
                self._start(side, [*module, *self._times])

    @property
    def node_alive(self) -> bool:
        """Whether the node's process is there."""
        return self._running['node'].poll() is None

    def node_mb(self) -> float:
        """Resident size of the node, MB."""
        pages = int(Path(f'/proc/{self._running["node"].pid}/statm').read_text().split()[1])
        return pages * resource.getpagesize() / 1e6

    def bring(self, fault: Fault | None) -> None:
        """End what went wrong before, begin what goes wrong now."""
        if fault == self._fault:
            return
        self._undo()
        self._fault = fault
        if fault is None:
            return
        self.brought[fault.kind] += 1
        if fault.kind in ('kill source', 'kill target'):
            self._kill(fault.kind.removeprefix('kill '))
        elif fault.kind == 'slow processor':
            for number in range(2 * (os.cpu_count() or 1)):
                self._start(f'busy {number}', ['-c', BUSY])
        elif fault.kind == 'full disk':
            self._disk(FULL)
            out = self._folder / f'recorded_{len(self._recordings)}'
            recording = ['-m', 'gcl_ros.soak.recording', str(self._bag), str(out)]
            self._recordings.append(self._process('recording', recording))

    def _undo(self) -> None:
        if self._fault is not None and self._fault.kind == 'full disk':
            self._disk(resource.RLIM_INFINITY)
        for name in [name for name in self._running if name.startswith('busy')]:
            self._kill(name)
        self.vehicles()

    def _disk(self, room: int) -> None:
        """Let the node's files grow to so many bytes: beyond, writing fails as on a full disk."""
        limits = (room, resource.RLIM_INFINITY)
        if self.node_alive:
            resource.prlimit(self._running['node'].pid, resource.RLIMIT_FSIZE, limits)

    def _kill(self, name: str) -> None:
        process = self._running.pop(name)
        process.send_signal(signal.SIGKILL)
        process.wait()

    def recordings_failed(self) -> str:
        """What recordings without room did wrong; empty where nothing."""
        failed = sum(not _ended_well(process) for process in self._recordings)
        if not failed:
            return ''
        log = (self._folder / 'recording.log').read_text()
        return f'{failed} of {len(self._recordings)}: {log[-500:]}'

    def stop(self) -> int | None:
        """End everything; return the node's exit code, None where it had to be killed."""
        self._disk(resource.RLIM_INFINITY)
        node = self._running.pop('node')
        for name in list(self._running):
            self._kill(name)
        node.terminate()
        try:
            return node.wait(timeout=60)
        except subprocess.TimeoutExpired:
            node.kill()
            return None


def _ended_well(process: subprocess.Popen[Any]) -> bool:
    try:
        return process.wait(timeout=RECORDED) == 0
    except subprocess.TimeoutExpired:
        process.kill()
        return False
