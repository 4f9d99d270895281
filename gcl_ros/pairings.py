"""Several sources against one target: pairs are taken in turn, so that none starves."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Generic, TypeVar

from gcl_ros.pairing import Pairing

M = TypeVar('M')


class Pairings(Generic[M]):
    """A pairing for each source, waited for together.

    Args:
        sources: names.
        max_dt: largest difference of the two stamps, seconds.
        on_demand: pairs wait until they are asked for.
    """

    def __init__(self, sources: Sequence[str], max_dt: float, *, on_demand: bool = False) -> None:
        self._ready = threading.Condition()
        self._closed = False
        self.of: dict[str, Pairing[M]] = {
            name: Pairing(max_dt, on_demand=on_demand, ready=self._ready) for name in sources
        }
        self._turn = list(sources)

    def add_target(self, stamp: float, message: M) -> None:
        """Take a message of the target, which every source may pair with."""
        for pairing in self.of.values():
            pairing.add('target', stamp, message)

    def take(self) -> tuple[str, M, M] | None:
        """Wait for a pair: name of the source, its message, the target's; None once closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._closed or any(p.due for p in self.of.values()))
            if self._closed:
                return None
            name = next(name for name in self._turn if self.of[name].due)
            self._turn.remove(name)
            self._turn.append(name)
            pair = self.of[name].take()
            return None if pair is None else (name, *pair)

    def close(self) -> None:
        """Wake the consumer for good."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()
