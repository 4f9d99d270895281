"""Pairs two streams by stamp and keeps only the newest pair."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeVar

from gcl_ros.rhythm import Rhythm

M = TypeVar('M')
Side = Literal['source', 'target']
SIDES: tuple[Side, Side] = ('source', 'target')
JUMP = 1.0  # seconds back: a bag that starts again or a clock that was set, not mere disorder
NEARER = 0.75  # of a pair's difference in time: what is so near takes the partner's place


@dataclass(frozen=True)
class Counts:
    """What became of the messages since the last reset.

    Attributes:
        pairs: pairs found.
        replaced: pairs that a newer one replaced before anybody took them.
        unpaired: messages without a partner.
        late: pairs older than one found before.
        jumps: jumps of the stamps back in time.
    """

    pairs: int = 0
    replaced: int = 0
    unpaired: int = 0
    late: int = 0
    jumps: int = 0


@dataclass(frozen=True)
class _Half(Generic[M]):
    """The newer message of the last pair, and how far its partner was from it in time."""

    side: Side
    stamp: float
    message: M
    dt: float


class Pairing(Generic[M]):
    """Two streams in, the newest pair out; older pairs are dropped, never queued.

    Args:
        max_dt: largest difference of the two stamps, seconds.
        depth: messages kept on each side while their partner may still come.
        on_demand: pairs wait until `ask` is called.
        ready: notified when something came; one for several pairings that are waited for together.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        max_dt: float,
        depth: int = 10,
        *,
        on_demand: bool = False,
        ready: threading.Condition | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.max_dt, self.on_demand = max_dt, on_demand
        self.counts = Counts()
        self._depth = depth
        self._ready = ready or threading.Condition()
        self._clock = clock
        self._asked = self._closed = self._forgotten = False
        self._forget_all()

    def _forget_all(self) -> None:
        self._waiting: dict[Side, deque[tuple[float, M]]] = {'source': deque(), 'target': deque()}
        self._last: dict[Side, float] = {}
        self._newest: tuple[M, M] | None = None
        self._taken: tuple[M, M] | None = None
        self._half: _Half[M] | None = None
        self._early: tuple[Side, M] | None = None
        self._rhythm = Rhythm()

    def _count(self, **more: int) -> None:
        now = {name: getattr(self.counts, name) + number for name, number in more.items()}
        self.counts = replace(self.counts, **now)

    def add(self, side: Side, stamp: float, message: M) -> None:
        """Take a message; wake the consumer if it completes a pair newer than any before."""
        other: Side = 'target' if side == 'source' else 'source'
        with self._ready:
            if stamp < self._last.get(side, stamp) - JUMP:
                self._forget_all()
                self._count(jumps=1)
            self._last[side] = stamp
            candidates = self._waiting[other]
            partner = min(candidates, key=lambda item: abs(item[0] - stamp), default=None)
            apart = self.max_dt if partner is None else abs(partner[0] - stamp)
            half = self._half if self._half and self._half.side == other else None
            if half and abs(half.stamp - stamp) < min(apart, NEARER * half.dt):
                # Else two streams out of step stay paired with the wrong neighbour for good.
                self._forget(side, stamp)
                self._pair(side, stamp, message, half.stamp, half.message)
                return
            if partner is None or apart > self.max_dt:
                self._keep(side, stamp, message)
                return
            self._forget(other, partner[0])
            self._forget(side, stamp)
            self._count(unpaired=-1)  # the partner was forgotten, but not alone
            self._pair(side, stamp, message, *partner)

    def _pair(self, side: Side, stamp: float, message: M, other_stamp: float, other: M) -> None:
        """Offer a message with its partner, unless they are older than the last pair."""
        self._count(pairs=1)
        newest = max(stamp, other_stamp)
        if self._half and newest < self._half.stamp:
            self._count(late=1)
            return
        self._count(replaced=self._newest is not None)
        self._rhythm.arrived(self._clock())
        self._early = None
        self._newest = (message, other) if side == 'source' else (other, message)
        newer: Side = side if stamp >= other_stamp else SIDES[side == 'source']
        half = message if newer == side else other
        self._half = _Half(newer, newest, half, abs(stamp - other_stamp))
        self._ready.notify_all()

    def _keep(self, side: Side, stamp: float, message: M) -> None:
        """Let a message wait for its partner; the oldest goes when there are too many."""
        waiting = self._waiting[side]
        waiting.append((stamp, message))
        if len(waiting) > self._depth:
            waiting.popleft()
            self._count(unpaired=1)
        if not self.on_demand and self._rhythm.expects(self._clock()):
            self._early = side, message
            self._ready.notify_all()

    def _forget(self, side: Side, stamp: float) -> None:
        """Drop what is not newer than a message that has just been paired."""
        waiting = self._waiting[side]
        kept = [item for item in waiting if item[0] > stamp]
        self._count(unpaired=len(waiting) - len(kept))
        waiting.clear()
        waiting.extend(kept)

    def offset(self, lately: float) -> float | None:
        """Newest stamp of the source minus that of the target, seconds.

        None without either, and while a pair came within the last `lately` seconds: one stream may
        be slower or later than the other without harm.
        """
        with self._ready:
            if len(self._last) < 2 or self._rhythm.quiet(self._clock()) < lately:
                return None
            return self._last['source'] - self._last['target']

    @property
    def waiting(self) -> int:
        """How many messages wait for a partner or to be taken."""
        with self._ready:
            alone = sum(len(side) for side in self._waiting.values())
            return alone + 2 * (self._newest is not None)

    @property
    def has_pair(self) -> bool:
        """Whether there is a pair to ask for."""
        with self._ready:
            return self._newest is not None or self._taken is not None

    def ask(self) -> bool:
        """Offer the newest pair, taken before or not; false when there is none."""
        with self._ready:
            self._asked = self._newest is not None or self._taken is not None
            self._ready.notify_all()
            return self._asked

    def take(self) -> tuple[M, M] | None:
        """Wait for the newest (source, target); None once closed."""
        with self._ready:
            self._ready.wait_for(lambda: self.due or self._closed)
            if self._closed:
                return None
            pair = self._newest or self._taken
            self._newest, self._taken, self._asked = None, pair, False
            self._forgotten = False
            return pair

    @property
    def forgotten(self) -> bool:
        """Whether there was a reset since the last pair was taken: what comes of it is past."""
        with self._ready:
            return self._forgotten

    def take_early(self) -> tuple[Side, M] | None:
        """A message whose partner is about to come, once; None without any."""
        with self._ready:
            early, self._early = self._early, None
            return early

    @property
    def due(self) -> bool:
        """Whether a pair is to be taken."""
        asked = self._asked and self.has_pair  # none is left after a jump back in time
        return asked or (self._newest is not None and not self.on_demand)

    @property
    def wait(self) -> float:
        """Seconds for which the pair that is due is better left for the next."""
        return 0.0 if self._asked else self._rhythm.wait(self._clock())

    def reset(self) -> None:
        """Forget everything, as after a jump back in time."""
        with self._ready:
            self._asked, self._forgotten = False, True
            self._forget_all()
            self.counts = Counts()

    def close(self) -> None:
        """Wake the consumer for good."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()
