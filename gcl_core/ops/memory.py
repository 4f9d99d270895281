"""The allocator's habits in a process that computes for long."""

from __future__ import annotations

import ctypes

TRIM_THRESHOLD, MMAP_THRESHOLD, ARENA_MAX = -1, -3, -8  # names of glibc's mallopt
LARGEST = 1 << 25  # bytes; the largest threshold that glibc takes for mmap


def keep_freed_memory(*, arenas: int | None = None) -> None:
    """Ask glibc not to hand buffers back at every free; page faults cost up to a third of a step.

    Buffers of 32 MB and more still come from mmap and go back: kept, they would fragment the heap
    to several times what is in use.

    Args:
        arenas: heaps that threads share; by default glibc gives each thread its own, and each
            keeps what it once held. For few threads that run for days one is enough.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, 'mallopt'):
        libc.mallopt(MMAP_THRESHOLD, LARGEST)
        libc.mallopt(TRIM_THRESHOLD, 1 << 30)
        if arenas is not None:
            libc.mallopt(ARENA_MAX, arenas)
