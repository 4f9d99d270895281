"""One input at a time within bounds of memory and time."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gcl_core.errors import GclError
from gcl_ros.fuzz.targets import Target

MEMORY = 512 << 20  # bytes that reading a small input may take on top of what the process has
PATIENCE = 5.0  # seconds of the processor that it may take


class HangError(BaseException):
    """An input took too long; no reader swallows it."""


@contextmanager
def bounded_memory(allowed: int = MEMORY) -> Iterator[None]:
    """Let the process map so many bytes more, and no more."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path('/proc/self/statm').read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + allowed, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def outcome(target: Target, data: bytes, folder: Path) -> str:
    """Feed one input to a reader, in a folder of its own: `read` or `refused`.

    Whatever else comes out of the reader goes on.

    Raises:
        AssertionError: the error does not tell what to make of it.
        HangError: it took longer than `PATIENCE`.
    """
    with _alarm():
        try:
            target.read(data, folder)
        except GclError as error:
            refusal = str(error)
        else:
            return 'read'
    assert len(refusal) > 15, f'this error names no value and no remedy: {refusal}'
    return 'refused'


@contextmanager
def _alarm() -> Iterator[None]:
    def ring(*_: Any) -> None:
        raise HangError

    signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
