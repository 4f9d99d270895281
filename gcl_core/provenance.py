"""What machine, and what version of the project, a measurement was made with."""

from __future__ import annotations

import datetime
import platform
import subprocess
from pathlib import Path
from typing import Any

import torch


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
