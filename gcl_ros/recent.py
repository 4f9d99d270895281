"""The last few results by what they were made from, which is told by identity."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Generic, TypeVar

V = TypeVar('V')


class Recent(Generic[V]):
    """Keeps the results last made or asked for; threads may make different ones at a time.

    Args:
        size: how many.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._lock = threading.Lock()
        self._kept: list[tuple[tuple[Any, ...], V]] = []

    def get(self, key: tuple[Any, ...], make: Callable[[], V]) -> V:
        """The result for the same objects, made if it is not kept."""
        with self._lock:
            entry = next((e for e in self._kept if _same(e[0], key)), None)
        if entry is None:
            entry = (key, make())
        with self._lock:
            self._kept = [*(e for e in self._kept if e is not entry), entry][-self._size :]
        return entry[1]


def _same(key: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    return all(a is b for a, b in zip(key, other, strict=True))
