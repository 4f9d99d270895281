"""An emulated radio channel: network namespaces that share one medium, for `gcl_ros.bench_link`.

Each station has a TAP device whose frames a thread here passes on: one at a time as the rate
allows, whoever sends, later by the delay, each lost at each receiver by chance. So it needs no
`tc netem`, which not every kernel has, and stations compete as on the air. What is not emulated:
collisions, back-off, retransmissions of the radio itself, distance.
"""

from __future__ import annotations

import fcntl
import math
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from gcl_core.errors import GclError

TUN = Path('/dev/net/tun')
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h
FRAME = 2048  # bytes; the devices carry 1,514
FRAMING = 24  # bytes of each frame that a device does not show: preamble, checksum, gap
QUEUE = 2000  # frames that wait in a station: one raw scan and a half
TURN = 64  # frames that are read of one station before another
DEVICE = 'gcl0'


@dataclass(frozen=True)
class Conditions:
    """What the air is like.

    Attributes:
        mbit: rate of the medium that all stations share, Mbit/s.
        loss: probability that a receiver does not hear a frame.
        delay: from the end of a frame to its reception, seconds.
    """

    mbit: float
    loss: float = 0.05
    delay: float = 0.02

    def __post_init__(self) -> None:
        if not 0.01 <= self.mbit <= 100:
            raise GclError(f'the rate is {self.mbit:g} Mbit/s; choose 0.01 to 100')
        if not 0 <= self.loss < 1:
            raise GclError(f'the loss is {self.loss:g}; choose 0 to less than 1')
        if not 0 <= self.delay <= 10:
            raise GclError(f'the delay is {self.delay:g} s; choose 0 to 10')


class Channel:
    """Stations on one medium; everything is removed at the end.

    Attributes:
        names: of the network namespaces.
        late: seconds by which each frame was passed on too late: whether the machine kept up.
        overflowed: frames that the queue of their station had no room for.

    Args:
        stations: how many.
        conditions: of the medium.
        seed: of what is lost.

    Raises:
        GclError: not root, or something that it needs is missing.
    """

    def __init__(self, stations: int, conditions: Conditions, seed: str = '') -> None:
        if os.geteuid() != 0 or not shutil.which('ip') or not TUN.exists():
            raise GclError(f'an emulated channel needs root, the program ip (iproute2) and {TUN}')
        self.conditions = conditions
        self.late: list[float] = []
        self.overflowed = 0
        self.names = [f'gcl_{os.getpid()}_{number}' for number in range(stations)]
        self._devices: list[int] = []
        self._random = random.Random(seed)
        self._open = True
        self._relay = threading.Thread(target=self._pass_on, daemon=True)

    def __enter__(self) -> Channel:
        try:
            for number in range(len(self.names)):
                self._add(number)
        except BaseException:
            self._remove()
            raise
        self._relay.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._open = False
        self._relay.join()
        self._remove()

    def start(self, station: int, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        """Start a program in a station; `options` are those of `subprocess.Popen`."""
        inside = ['ip', 'netns', 'exec', self.names[station]]
        return subprocess.Popen([*inside, *command], **options)

    def _add(self, number: int) -> None:
        """Make a namespace with the device of a station."""
        name = self.names[number]
        _do('ip', 'netns', 'add', name)
        device = os.open(TUN, os.O_RDWR | os.O_NONBLOCK)
        self._devices.append(device)
        outside = f'gcl{os.getpid() % 10**7}_{number}'
        request = struct.pack('16sH22x', outside.encode(), IFF_TAP | IFF_NO_PI)
        fcntl.ioctl(device, TUNSETIFF, request)
        _do('ip', 'link', 'set', outside, 'netns', name, 'name', DEVICE)
        inside = ['ip', '-netns', name]
        _do(*inside, 'link', 'set', DEVICE, 'address', address(number).hex(':'))
        _do(*inside, 'address', 'add', f'10.77.0.{number + 1}/24', 'dev', DEVICE)
        for each in ('lo', DEVICE):
            _do(*inside, 'link', 'set', each, 'up')

    def _remove(self) -> None:
        for device in self._devices:
            os.close(device)
        for name in self.names:
            with suppress(GclError):  # it was not made
                _do('ip', 'netns', 'delete', name)

    def _pass_on(self) -> None:
        """Take frames as they come, give them the medium in turn, deliver them in time.

        A thread that wakes late delivers late, but no air time is lost by it.
        """
        with suppress(PermissionError):  # before what else runs, if it may
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        due: deque[tuple[float, bytes, list[int]]] = deque()
        waiting: dict[int, deque[tuple[float, bytes]]] = {d: deque() for d in self._devices}
        free = 0.0  # when the medium is
        while self._open:
            now = time.monotonic()
            while free <= now and any(waiting.values()):
                for device, frames in waiting.items():
                    if frames:
                        came, frame = frames.popleft()
                        air = 8e-6 * (len(frame) + FRAMING) / self.conditions.mbit
                        free = max(free, came) + air
                        heard = free + self.conditions.delay
                        due.append((heard, frame, self._receivers(device, frame)))
            while due and due[0][0] <= now:
                self._deliver(now, *due.popleft())
            wake = min(
                (due[0][0] if due else now + 0.1), free if any(waiting.values()) else math.inf
            )
            for device in select.select(self._devices, [], [], max(0.0, wake - now))[0]:
                self._take(device, waiting[device])

    def _take(self, device: int, waiting: deque[tuple[float, bytes]]) -> None:
        """Read what a station has to send; what its queue does not hold is lost."""
        with suppress(BlockingIOError):  # nothing more
            for _ in range(TURN):
                frame = os.read(device, FRAME)
                if len(waiting) < QUEUE:
                    waiting.append((time.monotonic(), frame))
                else:
                    self.overflowed += 1

    def _receivers(self, sender: int, frame: bytes) -> list[int]:
        """Devices that hear a frame."""
        meant = [d for n, d in enumerate(self._devices) if frame[:6] == address(n)]
        others = meant or [device for device in self._devices if device != sender]
        return [device for device in others if self._random.random() >= self.conditions.loss]

    def _deliver(self, now: float, time_due: float, frame: bytes, receivers: list[int]) -> None:
        self.late.append(now - time_due)
        for device in receivers:
            with suppress(OSError):  # a station whose device is not up yet hears nothing
                os.write(device, frame)


def address(number: int) -> bytes:
    """Ethernet address of a station."""
    return bytes((2, 0, 0, 0, 0, number + 1))


def _do(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise GclError(f'{" ".join(command)}: {done.stderr.strip()}')
