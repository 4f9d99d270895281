"""Several sources against one target: pairs are taken in turn, so that none starves."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Generic, TypeVar

from gcl_ros.pairing import SIDES, Pairing

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

    def take(self) -> tuple[str, M | None, M | None] | None:
        """Wait for work: name of the source, its message, the target's; None once closed.

        Meanwhile one of the two may come alone, None in place of the other: its partner is about
        to come, and the time can be used.
        """
        with self._ready:
            while not self._closed:
                waits = {name: self.of[name].wait for name in self._turn if self.of[name].due}
                if now := next((name for name, seconds in waits.items() if seconds <= 0), None):
                    return self._pair(now)
                for name, pairing in self.of.items():
                    if early := pairing.take_early():
                        return (name, *(early[1] if early[0] == s else None for s in SIDES))
                self._ready.wait(min(waits.values(), default=None))
            return None

    def _pair(self, name: str) -> tuple[str, M, M] | None:
        self._turn.remove(name)
        self._turn.append(name)
        pair = self.of[name].take()
        return None if pair is None else (name, *pair)

    def close(self) -> None:
        """Wake the consumer for good."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()
