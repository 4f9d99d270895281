"""When the next cloud or pair is due, from when the last ones came."""

from __future__ import annotations

from collections import deque

KEPT = 5  # arrivals that the period is taken from
SHORTEST, LONGEST = 0.5, 1.2  # periods after an arrival between which the next is awaited
JITTER = 0.25  # of a period, by which regular clouds may come early
FASTEST_WORK = 0.25  # seconds: for slower streams no pair is worth waiting for


class Rhythm:
    """Foretells arrivals; times are monotonic seconds."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=KEPT)

    def arrived(self, now: float) -> None:
        """Note a pair."""
        self._arrivals.append(now)

    def quiet(self, now: float) -> float:
        """Seconds since the last pair; inf before the first."""
        return now - self._arrivals[-1] if self._arrivals else float('inf')

    @property
    def period(self) -> float | None:
        """Seconds between pairs; None before there were two."""
        if len(self._arrivals) < 2:
            return None
        return (self._arrivals[-1] - self._arrivals[0]) / (len(self._arrivals) - 1)

    def expects(self, now: float) -> bool:
        """Whether a cloud that comes now is likely to be paired."""
        period = self.period
        if period is None:
            return False
        return SHORTEST * period <= now - self._arrivals[-1] <= LONGEST * period

    def wait(self, now: float) -> float:
        """Seconds for which the last pair is better left for the next, which is nearer than it.

        A consumer that is slower than the pairs come would else publish what is up to a period
        older than what it could.
        """
        period = self.period
        if period is None or period > FASTEST_WORK or not self.expects(now):
            return 0.0
        return LONGEST * period - (now - self._arrivals[-1])


class Throttle:
    """At most so many a second on average, and all of a regular stream of that rate."""

    def __init__(self) -> None:
        self._due = float('-inf')

    def passes(self, now: float, rate: float) -> bool:
        """Whether what comes now, monotonic seconds, is taken."""
        if now < self._due:
            return False
        self._due = max(self._due + 1 / rate, now + (1 - JITTER) / rate)
        return True
