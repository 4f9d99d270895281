"""Compile the kernels for an instruction set, once, into a folder of the user's own."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from gcl_core.ops.native.instructions import OFF, SWITCH, InstructionSet, held

log = logging.getLogger(__name__)
SOURCES = (
    'kernel_map.cpp',
    'kpconv.cpp',
    'nearest.cpp',
    'octree.cpp',
    'radius.cpp',
    'sparse_conv.cpp',
    'support.cpp',
    'voxelize.cpp',
)
HEADERS = ('product.h',)
FLAGS = ('-O3', '-fopenmp', '-shared', '-fPIC', '-fno-exceptions', '-fno-rtti')
COMPILE_SECONDS = 120
OTHERS_WRITE = 0o022


def library() -> ctypes.CDLL | None:
    """Load the kernels, compiling them if this machine has not yet (2 s); None if it cannot.

    Says in the log, once, which it is and why.

    Raises:
        GclError: `GCL_NATIVE` holds them to what the processor lacks, see `instructions.held`.
    """
    return _loaded(held())


@cache
def _loaded(instructions: InstructionSet | None) -> ctypes.CDLL | None:
    if instructions is None:
        log.info('sparse convolution: plain torch (%s=%s)', SWITCH, OFF)
        return None
    compiler = shutil.which(os.environ.get('CXX', 'c++'))
    if compiler is None:
        log.info('sparse convolution: plain torch, several times slower; for speed install g++')
        return None
    try:
        loaded = _load(compiler, instructions)
    except (OSError, subprocess.SubprocessError) as error:
        log.warning('sparse convolution: plain torch; compiling failed: %s', error)
        return None
    log.info('sparse convolution: compiled kernels (%s)', instructions.name)
    return loaded


def command(compiler: str, options: tuple[str, ...], out: Path) -> list[str]:
    """What compiles all kernels into one shared library."""
    here = Path(__file__).parent
    return [compiler, *FLAGS, *options, '-o', str(out), *(str(here / name) for name in SOURCES)]


def _load(compiler: str, instructions: InstructionSet) -> ctypes.CDLL:
    """Load what lies in a folder of the user's own; compile it there if it lies in none."""
    name = f'kernels-{instructions.name}-{_digest(compiler, instructions)}.so'
    folders = list(_folders())
    for folder in folders:
        if _own(folder) and _own(folder / name):
            return ctypes.CDLL(str(folder / name))
    for folder in folders:
        if _prepared(folder):
            with tempfile.TemporaryDirectory(dir=folder) as scratch:
                fresh = _compiled(compiler, instructions, Path(scratch) / name)
                fresh.replace(folder / name)  # atomic: a second process finds all or nothing
            return ctypes.CDLL(str(folder / name))
    log.info('no folder to keep the compiled kernels in: they are compiled at each start')
    with tempfile.TemporaryDirectory(prefix='gcl_ros_') as scratch:
        return ctypes.CDLL(str(_compiled(compiler, instructions, Path(scratch) / name)))


def _compiled(compiler: str, instructions: InstructionSet, out: Path) -> Path:
    build = command(compiler, instructions.options, out)
    subprocess.run(build, capture_output=True, check=True, timeout=COMPILE_SECONDS)
    out.chmod(0o700)  # whatever the user's mask: what others may write is not loaded
    return out


def _digest(compiler: str, instructions: InstructionSet) -> str:
    """Tells these sources, this compiler and these options from others."""
    here = Path(__file__).parent
    version = subprocess.run([compiler, '--version'], capture_output=True, check=True, timeout=10)
    parts = [(here / name).read_bytes() for name in (*SOURCES, *HEADERS)]
    parts += [version.stdout, ' '.join((*FLAGS, *instructions.options)).encode()]
    return hashlib.sha256(b'\0'.join(parts)).hexdigest()[:16]


def _folders() -> Iterator[Path]:
    """Where the kernels may lie: the user's cache, or for want of it a temporary folder."""
    try:
        cache_folder = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache')
        if cache_folder.is_absolute():
            yield cache_folder / 'gcl_ros'
    except RuntimeError:  # a container's user without HOME, or an entry in passwd
        pass
    yield Path(tempfile.gettempdir()) / f'gcl_ros-{os.getuid()}'


def _own(path: Path) -> bool:
    """Whether it is there, and no one but this user and root can have written it."""
    try:
        seen = path.lstat(), path.stat()  # a link counts as who made it, too
    except OSError:
        return False
    owners = {0, os.getuid()}
    return all(s.st_uid in owners for s in seen) and not seen[1].st_mode & OTHERS_WRITE


def _prepared(folder: Path) -> bool:
    """Make a folder if need be; whether it is the user's own and can be written to."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        return False
    return _own(folder)
