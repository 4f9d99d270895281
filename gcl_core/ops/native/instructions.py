"""Which instructions the compiled kernels use: the most that the processor has, or as held to.

The environment variable `GCL_NATIVE` holds them: the name of a set, or 0 for plain torch.
"""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from gcl_core.errors import GclError

SWITCH, OFF, BEST = 'GCL_NATIVE', '0', ('', '1')


@dataclass(frozen=True)
class InstructionSet:
    """What a compiler may use.

    Attributes:
        name: as `GCL_NATIVE` takes it.
        machine: `platform.machine()` of its processors; empty for any.
        options: of the compiler.
        needs: flags of the processor, as the kernel names them.
        bf16: whether bfloat16 numbers are multiplied by one instruction.
    """

    name: str
    machine: str
    options: tuple[str, ...]
    needs: frozenset[str]
    bf16: bool = False


_AVX2 = ('avx2', 'fma', 'bmi1', 'bmi2', 'f16c')
_AVX512 = ('avx512f', 'avx512bw', 'avx512cd', 'avx512dq', 'avx512vl')
_BF16 = ('avx512_bf16',)
_NAMED_OTHERWISE = {'bmi1': 'bmi', 'avx512_bf16': 'avx512bf16'}  # by the compiler


def _x86(name: str, *needs: str, bf16: bool = False) -> InstructionSet:
    options = tuple(f'-m{_NAMED_OTHERWISE.get(flag, flag)}' for flag in needs)
    return InstructionSet(name, 'x86_64', options, frozenset(needs), bf16)


# Best first. Tile instructions (AMX) are not here: no kernel uses them.
SETS = (
    _x86('avx512_bf16', *_AVX2, *_AVX512, *_BF16, bf16=True),
    _x86('avx512', *_AVX2, *_AVX512),
    _x86('avx2', *_AVX2),
    InstructionSet('neon', 'aarch64', (), frozenset()),
    InstructionSet('baseline', '', (), frozenset()),
)


def flags() -> frozenset[str]:
    """What this processor can do, in the words of Linux; nothing where it is not told."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        return frozenset()
    told = next((line for line in lines if line.startswith('flags')), ':')
    return frozenset(told.split(':', 1)[1].split())


def of(machine: str) -> tuple[InstructionSet, ...]:
    """The sets of a kind of processor, as `platform.machine()` calls it, best first."""
    return tuple(s for s in SETS if s.machine in ('', machine))


@cache
def available() -> tuple[InstructionSet, ...]:
    """The sets that this machine can run, best first; the last is there on every machine."""
    found = flags()
    return tuple(s for s in of(platform.machine()) if s.needs <= found)


def held() -> InstructionSet | None:
    """The set that the kernels are to use; None for plain torch.

    Raises:
        GclError: `GCL_NATIVE` names none, or one that this processor lacks.
    """
    wanted = os.environ.get(SWITCH, '')
    if wanted == OFF:
        return None
    if wanted in BEST:
        return available()[0]
    for one in available():
        if one.name == wanted:
            return one
    can = ', '.join([OFF, *(one.name for one in available())])
    lacking = next((one for one in SETS if one.name == wanted), None)
    if lacking is None:
        why = 'names no instruction set'
    else:
        missing = sorted(lacking.needs - flags()) or [f'a processor of {lacking.machine}']
        why = f'this machine lacks {", ".join(missing)}'
    raise GclError(f'{SWITCH} is {wanted!r}: {why}; choose one of {can}, or unset it')
