"""How much memory a piece of work takes, in a process that goes on."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar('T')


def weighed(work: Callable[[], T]) -> tuple[T, float]:
    """Run `work`; also return by how many MB the process grew at most meanwhile.

    Memory that was freed before and is still held goes back to the system first, so that what
    `work` takes from there counts. nan where the system does not tell (other than Linux, or a
    container that forbids `/proc/self/clear_refs`).
    """
    try:
        ctypes.CDLL(None).malloc_trim(0)
        Path('/proc/self/clear_refs').write_text('5')  # the peak begins anew (man 5 proc)
        before = _status_mb('VmRSS')
    except (OSError, AttributeError, StopIteration):
        return work(), float('nan')
    result = work()
    return result, max(0.0, _status_mb('VmHWM') - before)


def _status_mb(key: str) -> float:
    lines = Path('/proc/self/status').read_text().splitlines()
    line = next(line for line in lines if line.startswith(key))
    return int(line.split()[1]) / 1024
