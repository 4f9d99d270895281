"""What machine, and what version of the project, a measurement was made with."""

from __future__ import annotations

import datetime
import platform
import subprocess
from pathlib import Path
from typing import Any

import torch

from gcl_core.errors import GclError
from gcl_core.files import check_writable

ROOT = Path(__file__).parents[1]
RESULTS = ('bench', 'docs')  # where the repository keeps what was measured, and says it


def provenance_for(*outputs: Path) -> dict[str, Any]:
    """Provenance of a measurement that begins, and whose results go to these files.

    Raises:
        GclError: one lies in the repository, and the program that measures is not committed.
    """
    kept = [o for o in outputs if any(o.resolve().is_relative_to(ROOT / r) for r in RESULTS)]
    if kept and (changed := _changed()):
        raise GclError(
            f'no measurement for {kept[0]}: {", ".join(changed[:5])} '
            'changed since the last commit, so that nobody could measure it again; commit, or '
            'write elsewhere with --out build/NAME'
        )
    check_writable(*outputs)
    return provenance()


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
    commit = _git('rev-parse', '--short', 'HEAD')
    return f'{commit.strip()}{"-dirty" if _changed() else ""}' if commit else 'unknown'


def _changed() -> list[str]:
    """Files of the program that differ from the last commit, or are new; results aside."""
    aside = [f':(exclude){name}' for name in (*RESULTS, '*.md')]
    return [line[3:] for line in _git('status', '--porcelain', '--', '.', *aside).splitlines()]


def _git(*arguments: str) -> str:
    """What git says of the repository; nothing where there is none."""
    try:
        command = ['git', *arguments]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ''
