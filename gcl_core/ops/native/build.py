"""Compile the kernels for this processor, once, into the user's cache."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

log = logging.getLogger(__name__)
SOURCES = (
    'kernel_map.cpp',
    'kpconv.cpp',
    'nearest.cpp',
    'octree.cpp',
    'radius.cpp',
    'sparse_conv.cpp',
    'voxelize.cpp',
)
HEADERS = ('product.h',)
FLAGS = ('-O3', '-march=native', '-fopenmp', '-shared', '-fPIC', '-fno-exceptions', '-fno-rtti')
SWITCH = 'GCL_NATIVE'  # environment variable; 0 keeps to plain torch
COMPILE_SECONDS = 120


@cache
def library() -> ctypes.CDLL | None:
    """Load the kernels, compiling them if this machine has not yet (2 s); None if it cannot.

    Says in the log, once, which it is and why.
    """
    if os.environ.get(SWITCH, '1') == '0':
        log.info('sparse convolution: plain torch (%s=0)', SWITCH)
        return None
    compiler = shutil.which(os.environ.get('CXX', 'c++'))
    if compiler is None:
        log.info('sparse convolution: plain torch, several times slower; for speed install g++')
        return None
    try:
        loaded = ctypes.CDLL(str(_compiled(compiler)))
    except (OSError, subprocess.SubprocessError) as error:
        log.warning('sparse convolution: plain torch; compiling failed: %s', error)
        return None
    log.info('sparse convolution: compiled kernels')
    return loaded


def _compiled(compiler: str) -> Path:
    """Path of the shared library for these sources, this compiler and this processor."""
    here = Path(__file__).parent
    sources = [here / name for name in SOURCES]
    version = subprocess.run([compiler, '--version'], capture_output=True, check=True, timeout=10)
    parts = [path.read_bytes() for path in (*sources, *(here / name for name in HEADERS))]
    parts += [version.stdout, ' '.join(FLAGS).encode(), _processor().encode()]
    name = hashlib.sha256(b'\0'.join(parts)).hexdigest()[:16]
    path = _cache_folder() / f'kernels-{name}.so'
    if not path.is_file():
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            fresh = Path(folder) / path.name
            command = [compiler, *FLAGS, '-o', str(fresh), *map(str, sources)]
            subprocess.run(command, capture_output=True, check=True, timeout=COMPILE_SECONDS)
            fresh.replace(path)  # atomic: a second process finds all of it or nothing
    return path


def _processor() -> str:
    """What `-march=native` depends on; a home folder may be shared between machines."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        return platform.processor() + platform.machine()
    return '\n'.join(sorted({line for line in lines if line.startswith(('flags', 'model'))}))


def _cache_folder() -> Path:
    """The user's own cache folder, which no one else can write to."""
    base = os.environ.get('XDG_CACHE_HOME') or str(Path.home() / '.cache')
    folder = Path(base) / 'gcl_ros'
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owned = folder.stat().st_uid == os.getuid() and not folder.stat().st_mode & 0o022
        if owned and os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix='gcl_ros_'))
