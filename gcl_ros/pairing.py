"""Pairs two streams by stamp and keeps only the newest pair."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, Literal, TypeVar

M = TypeVar('M')
Side = Literal['source', 'target']


class Pairing(Generic[M]):
    """Two streams in, the newest pair out; older pairs are dropped, never queued.

    Args:
        max_dt: largest difference of the two stamps, seconds.
        depth: messages kept on each side while their partner may still come.
    """

    def __init__(self, max_dt: float, depth: int = 10) -> None:
        self._max_dt = max_dt
        self._waiting: dict[Side, deque[tuple[float, M]]] = {
            'source': deque(maxlen=depth),
            'target': deque(maxlen=depth),
        }
        self._newest: tuple[M, M] | None = None
        self._newest_stamp = float('-inf')
        self._ready = threading.Condition()
        self._closed = False
        self.dropped = 0

    def add(self, side: Side, stamp: float, message: M) -> None:
        """Take a message; wake the consumer if it completes a pair newer than any before."""
        other: Side = 'target' if side == 'source' else 'source'
        with self._ready:
            candidates = self._waiting[other]
            partner = min(candidates, key=lambda item: abs(item[0] - stamp), default=None)
            if partner is None or abs(partner[0] - stamp) > self._max_dt:
                self._waiting[side].append((stamp, message))
                return
            self._forget(other, partner[0])
            self._forget(side, stamp)
            newest = max(stamp, partner[0])
            if newest < self._newest_stamp:
                return
            self._newest_stamp = newest
            self.dropped += self._newest is not None
            pair = (message, partner[1])
            self._newest = pair if side == 'source' else (pair[1], pair[0])
            self._ready.notify()

    def _forget(self, side: Side, stamp: float) -> None:
        """Drop what is not newer than a message that has just been paired."""
        waiting = self._waiting[side]
        kept = [item for item in waiting if item[0] > stamp]
        waiting.clear()
        waiting.extend(kept)

    def take(self) -> tuple[M, M] | None:
        """Wait for the newest (source, target); None once closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._newest is not None or self._closed)
            if self._closed:
                return None
            pair, self._newest = self._newest, None
            return pair

    def reset(self) -> None:
        """Forget everything, as after a jump back in time."""
        with self._ready:
            for waiting in self._waiting.values():
                waiting.clear()
            self._newest, self._newest_stamp = None, float('-inf')

    def close(self) -> None:
        """Wake the consumer for good."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()
