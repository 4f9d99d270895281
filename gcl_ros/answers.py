"""Callers of `~/trigger` wait here for what comes out."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rclpy.task import Future


@dataclass(frozen=True)
class _Caller:
    """One who waits: for which sources still, and what has been told of the others."""

    number: int
    future: Future
    missing: set[str]
    told: dict[str, tuple[bool, str]] = field(default_factory=dict)


class Answers:
    """Futures, each of which waits for the next outcome of some sources."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[_Caller] = []
        self._calls = 0

    @property
    def waiting(self) -> int:
        """How many callers wait."""
        with self._lock:
            return len(self._waiting)

    @property
    def calls(self) -> int:
        """How many have called so far."""
        with self._lock:
            return self._calls

    def expect(self, sources: Sequence[str], executor: Any) -> Future:
        """A future of (success of any, text) once each source has had an outcome.

        Args:
            sources: names.
            executor: that runs the callback which awaits the future.
        """
        future: Future = Future(executor=executor)
        with self._lock:
            self._calls += 1
            self._waiting.append(_Caller(self._calls, future, set(sources)))
        return future

    def outcome(self, source: str, success: bool, text: str, *, calls: int) -> None:
        """Tell an outcome to those who wait for it.

        Args:
            source: name.
            success: whether a transform was accepted.
            text: the outcome in words.
            calls: how many had called when the pair was taken: to others it is no answer.
        """
        with self._lock:
            for caller in self._waiting:
                if source in caller.missing and caller.number <= calls:
                    caller.missing.remove(source)
                    caller.told[source] = success, text
            done = [caller for caller in self._waiting if not caller.missing]
            self._waiting = [caller for caller in self._waiting if caller.missing]
        for caller in done:
            told = caller.told
            several = len(told) > 1
            texts = [f'{name}: {t}' if several else t for name, (_, t) in told.items()]
            caller.future.set_result((any(good for good, _ in told.values()), '; '.join(texts)))

    def give_up(self, text: str) -> None:
        """Answer everybody that nothing will come."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
        for caller in waiting:
            caller.future.set_result((False, text))
