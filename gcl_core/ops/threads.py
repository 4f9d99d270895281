"""Two pieces of work side by side, each with half of the processors."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

A = TypeVar('A')
B = TypeVar('B')


class SideBySide:
    """Runs two functions at a time.

    Two scans are prepared faster so than one after the other by all processors together: most
    steps are too short to be shared. Results do not depend on the number of threads.
    """

    def __init__(self) -> None:
        self._helper = ThreadPoolExecutor(1, thread_name_prefix='side')

    def __call__(self, first: Callable[[], A], second: Callable[[], B]) -> tuple[A, B]:
        """Return what both return; an error of either comes when both have ended."""
        threads = torch.get_num_threads()
        half = max(1, threads // 2)
        torch.set_num_threads(half)
        try:
            other = self._helper.submit(_with_threads, half, second)
            try:
                one = first()
            finally:
                other.exception()  # whatever happened here, the helper is free again
            return one, other.result()
        finally:
            torch.set_num_threads(threads)

    def close(self) -> None:
        """End the helping thread."""
        self._helper.shutdown(wait=False, cancel_futures=True)


def _with_threads(threads: int, work: Callable[[], B]) -> B:
    torch.set_num_threads(threads)  # OpenMP counts them for each thread that asks
    return work()
