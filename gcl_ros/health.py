"""What the registrar knows about itself, and what of it is a warning or an error."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gcl_core.types import Registration
from gcl_ros.pairing import Counts, Side

OK, WARN, ERROR = range(3)  # as bytes in diagnostic_msgs/DiagnosticStatus
HANGS = 5  # clouds on end with the same bytes: two sweeps of a LiDAR never have them
ANOTHER_CLOCK = 3600.0  # seconds: no worker is so late, the stamps are not of the node's clock


@dataclass(frozen=True)
class Outcome:
    """One pair, registered or withheld.

    Attributes:
        result: of the registrar.
        age: from the later stamp to the end of the work, seconds of the node's clock.
        dt: stamp of the source minus that of the target, seconds.
        headings: that were searched.
    """

    result: Registration
    age: float
    dt: float
    headings: int


@dataclass
class Stream:
    """One topic of clouds.

    Attributes:
        count: clouds received.
        heard: when the last came in, monotonic seconds.
        frame: of the last.
        repeats: how often the last has come on end, with other stamps.
    """

    count: int = 0
    heard: float | None = None
    frame: str = ''
    repeats: int = 0


@dataclass(frozen=True)
class Limits:
    """When to warn.

    Attributes:
        silence: seconds without a cloud.
        max_age: seconds from stamp to transform.
        max_pair_dt: seconds between the stamps of a pair.
    """

    silence: float
    max_age: float
    max_pair_dt: float


@dataclass
class Health:
    """Counts and the last outcome; filled by callbacks and worker, read by the diagnostics.

    Attributes:
        source: what the source is called.
        streams: the topics of both sides.
        accepted: pairs whose transform was.
        withheld: pairs whose transform was not.
        left_out: pairs that could not be worked on.
        last: the last pair that was worked on.
        fault: why the last pair was left out; empty if it was not.
        why: the last reasons to refuse a pair.
        began: when listening began, monotonic seconds.
    """

    source: str = 'source'
    streams: dict[Side, Stream] = field(
        default_factory=lambda: {'source': Stream(), 'target': Stream()}
    )
    accepted: int = 0
    withheld: int = 0
    left_out: int = 0
    last: Outcome | None = None
    fault: str = ''
    why: dict[str, str] = field(default_factory=dict)
    began: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def heard(self, side: Side, frame: str, now: float, *, again: bool = False) -> None:
        """Note a cloud; `again` if it is the one before with another stamp."""
        with self._lock:
            stream = self.streams[side]
            stream.count, stream.heard, stream.frame = stream.count + 1, now, frame
            stream.repeats = stream.repeats + 1 if again else 0

    def done(self, outcome: Outcome) -> None:
        """Note a pair that was worked on."""
        with self._lock:
            self.last, self.fault = outcome, ''
            self.accepted += outcome.result.accepted
            self.withheld += not outcome.result.accepted
            if not outcome.result.accepted:
                self.why['last withheld'] = outcome.result.reason

    def failed(self, reason: str) -> None:
        """Note a pair that was left out."""
        with self._lock:
            self.left_out, self.fault = self.left_out + 1, reason
            self.why['last left out'] = reason

    def judge(self, now: float, limits: Limits, offset: float | None) -> tuple[int, str]:
        """Level and message of the diagnostics while the node is active.

        ERROR: the last pair could not be worked on. WARN: a topic is silent; the stamps of the
        topics are too far apart to pair; a topic repeats one cloud; both are in one frame; the
        last transform was withheld, or came late.
        """
        with self._lock:
            if self.fault:
                return ERROR, f'last pair left out: {self.fault}'
            silent = [self._silence(side, now) for side in self.streams]
            warnings = [
                f'{self._topic(side)} silent for {seconds:.1f} s'
                for side, seconds in zip(self.streams, silent, strict=True)
                if seconds > limits.silence
            ]
            if not warnings and offset is not None and abs(offset) > limits.max_pair_dt:
                warnings.append(
                    f'stamps {offset:+.3f} s apart (source minus target), {limits.max_pair_dt:g} '
                    'allowed: are the clocks synchronised?'
                )
            warnings += [
                f'{self._topic(side)} sends one cloud again and again with new stamps: does its '
                'driver hang?'
                for side, stream in self.streams.items()
                if stream.repeats >= HANGS
            ]
            frames = {stream.frame for stream in self.streams.values()}
            if len(frames) == 1 and '' not in frames:
                warnings.append(
                    f'both clouds are in frame {frames.pop()!r}: give each LiDAR one of its own'
                )
            if self.last is not None and not self.last.result.accepted:
                warnings.append(f'no transform: {self.last.result.reason}')
            elif self.last is not None and abs(self.last.age) > ANOTHER_CLOCK:
                warnings.append(
                    f'stamps {self.last.age:.0f} s behind the clock of the node: '
                    'is use_sim_time as they need it?'
                )
            elif self.last is not None and self.last.age > limits.max_age:
                warnings.append(f'transform {self.last.age:.2f} s old, {limits.max_age:g} wanted')
            if warnings:
                return WARN, '; '.join(warnings)
            return OK, 'registering' if self.last else 'waiting for the first pair'

    def _topic(self, side: Side) -> str:
        return f'{self.source if side == "source" else side}/points'

    def _silence(self, side: Side, now: float) -> float:
        heard = self.streams[side].heard
        return now - (self.began if heard is None else heard)

    def figures(self, now: float, counts: Counts) -> dict[str, str]:
        """Every figure by its key."""
        with self._lock:
            rows: dict[str, object] = {}
            for side, stream in self.streams.items():
                rows[f'{side} clouds'] = stream.count
                rows[f'{side} frame'] = stream.frame
                rows[f'{side} silent s'] = f'{self._silence(side, now):.2f}'
                rows[f'{side} repeats'] = stream.repeats
            rows |= {
                'pairs': counts.pairs,
                'accepted': self.accepted,
                'withheld': self.withheld,
                'left out': self.left_out,
                'replaced by newer': counts.replaced,
                'clouds without partner': counts.unpaired,
                'pairs out of order': counts.late,
                'jumps back in time': counts.jumps,
                **self.why,
            }
            if self.last is not None:
                rows |= _figures_of(self.last)
            return {key: str(value) for key, value in rows.items()}


def _figures_of(outcome: Outcome) -> Mapping[str, object]:
    result = outcome.result
    rows: dict[str, object] = {
        'age s': f'{outcome.age:.3f}',
        'dt s': f'{outcome.dt:.4f}',
        'headings': outcome.headings,
        'inliers': result.inliers,
        'correspondences': result.correspondences,
        'probability': f'{result.probability:.4f}',
        'reason withheld': result.reason,
    }
    if result.accepted and result.T_target_source is not None:
        rows['distance m'] = f'{np.linalg.norm(result.T_target_source[:3, 3]):.2f}'
    return rows | {f'{stage} ms': f'{ms:.1f}' for stage, ms in result.ms.items()}
