"""What the registrar knows about itself, and what of it is a warning or an error."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gcl_core.types import Registration
from gcl_ros.pairing import Counts, Side
from gcl_ros.streams import Limits, Stream, of_frames
from gcl_ros.wiring import Wires

OK, WARN, ERROR = range(3)  # as bytes in diagnostic_msgs/DiagnosticStatus
SLOW = 0.5  # seconds before a cloud came, that are told apart from the work on it


@dataclass(frozen=True)
class Outcome:
    """One pair, registered or withheld.

    Attributes:
        result: of the registrar.
        age: from the later stamp to the end of the work, seconds of the node's clock.
        dt: stamp of the source minus that of the target, seconds.
    """

    result: Registration
    age: float
    dt: float


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
    streams: dict[Side, Stream] = field(init=False)
    accepted: int = 0
    withheld: int = 0
    left_out: int = 0
    last: Outcome | None = None
    fault: str = ''
    why: dict[str, str] = field(default_factory=dict)
    began: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self.streams = {
            'source': Stream(f'{self.source}/points', began=self.began),
            'target': Stream('target/points', began=self.began),
        }

    def heard(
        self,
        side: Side,
        frame: str,
        stamp: float,
        *,
        now: float,
        clock: float,
        again: bool = False,
    ) -> None:
        """Note a cloud; see `Stream.note`."""
        with self._lock:
            self.streams[side].note(frame, stamp, now=now, clock=clock, again=again)

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

    def judge(
        self,
        now: float,
        limits: Limits,
        offset: float | None,
        *,
        wires: Mapping[Side, Wires] | None = None,
        others: Sequence[str] = (),
    ) -> tuple[int, str]:
        """Level and message of the diagnostics while the node is active.

        ERROR: the last pair could not be worked on. WARN: anything is odd about a topic or its
        stamps, see `Stream.warnings`; the stamps of the topics are too far apart to pair; both are
        in one frame; the last transform was withheld, or came late.

        Args:
            now: monotonic seconds.
            limits: when to warn.
            offset: stamp of the source minus that of the target where nothing pairs, seconds.
            wires: what the graph says of the topics.
            others: warnings of the odometry.
        """
        with self._lock:
            if self.fault:
                return ERROR, f'last pair left out: {self.fault}'
            warnings: list[str] = []
            for side, stream in self.streams.items():
                warnings += stream.warnings(now, limits, wires[side] if wires else None)
            silent = any(s.silence(now) > limits.silence for s in self.streams.values())
            if not silent and offset is not None and abs(offset) > limits.max_pair_dt:
                warnings.append(
                    f'stamps {offset:+.3f} s apart (source minus target), {limits.max_pair_dt:g} '
                    'allowed: are the clocks synchronised?'
                )
            warnings += [*of_frames(list(self.streams.values())), *others]
            if self.last is not None:
                warnings += self._of_last(self.last, limits)
            if warnings:
                return WARN, '; '.join(warnings)
            return OK, 'registering' if self.last else 'waiting for the first pair'

    def _of_last(self, last: Outcome, limits: Limits) -> list[str]:
        """What is odd about the last pair."""
        streams, odd = self.streams.values(), []
        if not last.result.calibrated:
            odd.append('uncalibrated: probabilities are those of other weights or settings')
        if not last.result.accepted:
            return [f'no transform: {last.result.reason}', *odd]
        if last.age <= limits.max_age or any(s.clock(limits.max_age) for s in streams):
            return odd
        lag = max(stream.lag for stream in streams)
        before = f', {lag:.2f} of it before its clouds came' if lag > SLOW else ''
        return [f'transform {last.age:.2f} s old, {limits.max_age:g} wanted{before}', *odd]

    def figures(self, now: float, counts: Counts) -> dict[str, str]:
        """Every figure by its key."""
        with self._lock:
            rows: dict[str, object] = {}
            for side, stream in self.streams.items():
                rows[f'{side} clouds'] = stream.count
                rows[f'{side} frame'] = stream.frame
                rows[f'{side} silent s'] = f'{stream.silence(now):.2f}'
                rows[f'{side} behind s'] = f'{stream.lag:.3f}'
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
        'headings': outcome.result.headings,
        'inliers': result.inliers,
        'correspondences': result.correspondences,
        'probability': f'{result.probability:.4f}',
        'calibrated': result.calibrated,
        'reason withheld': result.reason,
    }
    if result.accepted and result.T_target_source is not None:
        rows['distance m'] = f'{np.linalg.norm(result.T_target_source[:3, 3]):.2f}'
    return rows | {f'{stage} ms': f'{ms:.1f}' for stage, ms in result.ms.items()}
