"""Callers of `~/trigger` wait here for what comes out."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from rclpy.task import Future


class Answers:
    """Futures, each of which waits for the next outcome of some sources."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[tuple[Future, set[str], dict[str, tuple[bool, str]]]] = []

    @property
    def waiting(self) -> int:
        """How many callers wait."""
        with self._lock:
            return len(self._waiting)

    def expect(self, sources: Sequence[str], executor: Any) -> Future:
        """A future of (success of any, text) once each source has had an outcome.

        Args:
            sources: names.
            executor: that runs the callback which awaits the future.
        """
        future: Future = Future(executor=executor)
        with self._lock:
            self._waiting.append((future, set(sources), {}))
        return future

    def outcome(self, source: str, success: bool, text: str) -> None:
        """Tell an outcome to everybody who waits for it."""
        with self._lock:
            done = []
            for future, missing, told in self._waiting:
                if source in missing:
                    missing.remove(source)
                    told[source] = success, text
                if not missing:
                    done.append((future, told))
            self._waiting = [entry for entry in self._waiting if entry[1]]
        for future, told in done:
            several = len(told) > 1
            texts = [f'{name}: {t}' if several else t for name, (_, t) in told.items()]
            future.set_result((any(good for good, _ in told.values()), '; '.join(texts)))

    def give_up(self, text: str) -> None:
        """Answer everybody that nothing will come."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
        for future, _, _ in waiting:
            future.set_result((False, text))
