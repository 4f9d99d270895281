"""Load the kernels for an instruction set: a wheel's, or compiled once for this user.

A wheel brings them compiled for every instruction set of its platform (setup.py calls `ship`), so
that a robot needs no compiler. From a checkout, or where the sources were changed since, they are
compiled at first use into a folder of the user's own.
"""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from gcl_core.ops.native.instructions import OFF, SWITCH, InstructionSet, held, of

log = logging.getLogger(__name__)
SOURCES = (
    'checks.cpp',
    'coarsen.cpp',
    'crop.cpp',
    'distinct.cpp',
    'grids.cpp',
    'ground.cpp',
    'heading.cpp',
    'kernel_map.cpp',
    'kpconv.cpp',
    'nearest.cpp',
    'octree.cpp',
    'radius.cpp',
    'range_image.cpp',
    'sparse_conv.cpp',
    'spread.cpp',
    'support.cpp',
    'voxelize.cpp',
)
HEADERS = ('directions.h', 'grid.h', 'order.h', 'product.h')
FLAGS = (
    *('-O3', '-fopenmp', '-shared', '-fPIC', '-fno-exceptions', '-fno-rtti'),
    '-fno-math-errno',  # roots of vectors; changes no number
)
COMPILE_SECONDS, SHIP_SECONDS = 120, 1200  # the second on an emulated machine, too
OTHERS_WRITE = 0o022
SHIPPED = Path(__file__).with_name('lib')  # in a wheel


def library() -> ctypes.CDLL | None:
    """Load the kernels, compiled here, once, if the package has none; None if that fails.

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
    loaded = _from_package(instructions)
    return _from_compiler(instructions) if loaded is None else loaded


def _from_package(instructions: InstructionSet) -> ctypes.CDLL | None:
    """Load what the wheel brought, if it is of these sources and loads on this system."""
    try:
        path = SHIPPED / shipped_name(instructions, platform.machine())
        if not path.exists():
            return None
        loaded = ctypes.CDLL(str(path))
    except OSError as error:  # for want of libgomp.so.1, say, which torch mostly brings
        log.warning('the kernels that come with the package do not load: %s', error)
        return None
    log.info('sparse convolution: compiled kernels (%s) of the package', instructions.name)
    return loaded


def _from_compiler(instructions: InstructionSet) -> ctypes.CDLL | None:
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


def shipped_name(instructions: InstructionSet, machine: str) -> str:
    """File name of a wheel's kernels: of these sources, for one kind of processor."""
    return f'kernels-{machine}-{instructions.name}-{_digest(instructions)}.so'


def ship(compiler: str, machine: str, folder: Path) -> list[Path]:
    """Compile the kernels for each instruction set of a kind of processor, for a wheel.

    A set that this compiler cannot compile for is left out, and named in the log: on processors
    that have it the kernels are compiled at first use.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for one in of(machine):
        out = folder / shipped_name(one, machine)
        try:
            subprocess.run(command(compiler, one.options, out), check=True, timeout=SHIP_SECONDS)
        except subprocess.SubprocessError as error:
            log.warning('no kernels for %s: %s', one.name, error)
            continue
        made.append(out)
    return made


def command(compiler: str, options: tuple[str, ...], out: Path) -> list[str]:
    """What compiles all kernels into one shared library."""
    here = Path(__file__).parent
    return [compiler, *FLAGS, *options, '-o', str(out), *(str(here / name) for name in SOURCES)]


def _load(compiler: str, instructions: InstructionSet) -> ctypes.CDLL:
    """Load what lies in a folder of the user's own; compile it there if it lies in none."""
    name = f'kernels-{instructions.name}-{_digest(instructions, _version(compiler))}.so'
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


def _digest(instructions: InstructionSet, compiler: bytes = b'') -> str:
    """Tells these sources, options and this compiler from others."""
    here = Path(__file__).parent
    parts = [(here / name).read_bytes() for name in (*SOURCES, *HEADERS)]
    parts += [compiler, ' '.join((*FLAGS, *instructions.options)).encode()]
    return hashlib.sha256(b'\0'.join(parts)).hexdigest()[:16]


def _version(compiler: str) -> bytes:
    told = subprocess.run([compiler, '--version'], capture_output=True, check=True, timeout=10)
    return told.stdout


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
