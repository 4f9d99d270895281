"""What a process takes of the machine, from Linux's /proc."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Usage:
    """One look at a process.

    Attributes:
        cpu: seconds of processor time so far, of all its threads.
        resident: bytes of memory that it holds.
    """

    cpu: float
    resident: int


def usage(pid: int) -> Usage:
    """Look at a process that runs."""
    process = Path('/proc') / str(pid)
    fields = (process / 'stat').read_text().rpartition(')')[2].split()
    ticks = int(fields[11]) + int(fields[12])  # utime and stime of proc(5)
    pages = int((process / 'statm').read_text().split()[1])
    return Usage(ticks / os.sysconf('SC_CLK_TCK'), pages * os.sysconf('SC_PAGE_SIZE'))


def growth(times: Sequence[float], values: Sequence[float], warm_up: float) -> float | None:
    """Slope of a straight line through what came after the warm-up; None with fewer than three.

    Args:
        times: of the values.
        values: in any unit.
        warm_up: time before which values do not count.
    """
    after = np.asarray(times) >= warm_up
    if after.sum() < 3:
        return None
    return float(np.polyfit(np.asarray(times)[after], np.asarray(values)[after], 1)[0])
