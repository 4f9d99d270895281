"""Time, memory, and what machine it was."""

from __future__ import annotations

import datetime
import platform
import resource
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
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


def provenance() -> dict[str, Any]:
    """Processor, threads, commit and date of a measurement."""
    return {
        'cpu': processor(),
        'threads': torch.get_num_threads(),
        'commit': _commit(),
        'date': datetime.date.today().isoformat(),
    }


def processor() -> str:
    """Name of the processor and the instructions that matter here."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    fields = dict(line.split(':', 1) for line in lines if ':' in line)
    found = {name.strip(): value for name, value in fields.items()}
    wanted = ('amx_bf16', 'avx512_bf16', 'avx512f', 'avx2')
    flags = [flag for flag in wanted if flag in found.get('flags', '').split()]
    return f'{found.get("model name", platform.machine()).strip()} ({", ".join(flags)})'


def _commit() -> str:
    command = ['git', 'describe', '--always', '--dirty', '--exclude=*']
    folder = Path(__file__).parent
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return 'unknown'
    return done.stdout.strip()
