"""The compiled kernels of every instruction set that this machine runs, or emulates."""

from __future__ import annotations

import atexit
import ctypes
import shutil
import struct
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from gcl_core.ops.native import build, instructions
from gcl_core.ops.native.kernels import Address

COMPILER, EMULATOR, SYSTEM = 'aarch64-linux-gnu-g++', 'qemu-aarch64', '/usr/aarch64-linux-gnu'
EMULATED = 'neon, emulated'


def sets() -> list[str]:
    """Instruction sets to test the kernels with; none without a compiler."""
    native = [one.name for one in instructions.available()] if build.library() else []
    return native + [EMULATED] * bool(shutil.which(COMPILER) and shutil.which(EMULATOR))


def hold(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hold the kernels to an instruction set."""
    if name == EMULATED:
        monkeypatch.setattr(build, '_loaded', lambda _: emulated())
    else:
        monkeypatch.setenv(instructions.SWITCH, name)
        assert build.library() is not None


@cache
def emulated() -> EmulatedLibrary:
    """The kernels of aarch64."""
    folder = Path(tempfile.mkdtemp(prefix='gcl_emulated_'))
    atexit.register(shutil.rmtree, folder)
    kernels = folder / 'kernels.so'
    subprocess.run(build.command(COMPILER, (), kernels), check=True)
    return EmulatedLibrary(kernels, folder / 'driver')


class EmulatedLibrary:
    """Stands where a `ctypes.CDLL` stands; what is called runs under user-mode emulation.

    The driver is compiled to where it is told.
    """

    _name = EMULATED

    def __init__(self, kernels: Path, driver: Path) -> None:
        source = Path(__file__).with_name('driver.cpp')
        subprocess.run([COMPILER, '-O1', '-o', driver, source, '-ldl'], check=True)
        self._process = subprocess.Popen(
            [EMULATOR, '-L', SYSTEM, driver, kernels],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        atexit.register(self._process.kill)

    def __getattr__(self, name: str) -> EmulatedFunction:
        function = EmulatedFunction(self, name)
        setattr(self, name, function)
        return function

    def call(self, name: str, arguments: tuple[Any, ...]) -> int:
        """Send the arguments there, and take the result and what was written to memory back."""
        request = [struct.pack('<Q', len(name)), name.encode(), struct.pack('<Q', len(arguments))]
        buffers = []
        for argument in arguments:
            if isinstance(argument, Address):
                size = argument.tensor.numel() * argument.tensor.element_size()
                assert argument.tensor.is_contiguous()
                content = ctypes.string_at(argument.value, size) if size else b''
                request += [b'p', struct.pack('<Q', size), content]
                buffers.append((argument, size))
            elif isinstance(argument, ctypes.c_float | ctypes.c_double):
                kind = 'f' if isinstance(argument, ctypes.c_float) else 'd'
                request.append(kind.encode() + struct.pack(f'<{kind}', argument.value))
            else:
                number = getattr(argument, 'value', argument) or 0
                request.append(b'i' + struct.pack('<q', number))
        self._process.stdin.write(b''.join(request))
        self._process.stdin.flush()
        (result,) = struct.unpack('<q', self._read(8))
        for address, size in buffers:
            ctypes.memmove(address, self._read(size), size)
        return result

    def _read(self, size: int) -> bytes:
        content = self._process.stdout.read(size)
        assert len(content) == size, f'the emulated process ended with {self._process.wait()}'
        return content


class EmulatedFunction:
    """One function; `argtypes` are taken and not needed."""

    argtypes: Any = None
    restype: Any = None

    def __init__(self, library: EmulatedLibrary, name: str) -> None:
        self._library, self._name = library, name

    def __call__(self, *arguments: Any) -> int:
        return self._library.call(self._name, arguments)
