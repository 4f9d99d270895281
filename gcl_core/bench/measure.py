"""Time and memory."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from typing import Any

import torch


def milliseconds(
    work: Callable[[], Any],
    repeats: int = 15,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Shortest of several runs after one to warm up: what other processes took is left out."""
    work()
    times = []
    for _ in range(repeats):
        began = clock()
        work()
        times.append(clock() - began)
    return 1e3 * min(times)


def peak_mb() -> float:
    """Largest resident size of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def gemm_gflops(dtype: torch.dtype, size: int = 2048) -> float:
    """Speed of a square matrix product in torch, GFLOP/s: the peak that others compare with."""
    a = torch.randn(size, size).to(dtype)
    return 2e-6 * size**3 / milliseconds(lambda: a @ a, 7)
