"""What is known of one topic that comes in, clouds or odometry alike, and what is odd about it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

from gcl_ros.clocks import another_clock
from gcl_ros.wiring import Wires

HANGS = 5  # messages on end with the same content: two sweeps of a LiDAR never have it
FRAMES, STAMPS = 20, 5  # messages whose frames, and whose stamps, are remembered


@dataclass(frozen=True)
class Limits:
    """When to warn.

    Attributes:
        silence: seconds without a message.
        max_age: seconds from stamp to transform.
        max_pair_dt: seconds between the stamps of a pair.
        reliable: subscriptions to clouds are.
    """

    silence: float
    max_age: float
    max_pair_dt: float
    reliable: bool = False


@dataclass
class Stream:
    """One topic.

    Attributes:
        topic: what warnings call it.
        kind: type of its messages.
        began: when listening began, monotonic seconds.
        count: messages received.
        heard: when the last came in, monotonic seconds.
        stamp: of the last, seconds.
        frames: of the last ones.
        behind: by how much the stamps of the last ones lay behind the node's clock as they came.
        repeats: how often the last has come on end, with other stamps.
    """

    topic: str
    kind: str = 'sensor_msgs/msg/PointCloud2'
    began: float = 0.0
    count: int = 0
    heard: float | None = None
    stamp: float = 0.0
    frames: deque[str] = field(default_factory=lambda: deque(maxlen=FRAMES))
    behind: deque[float] = field(default_factory=lambda: deque(maxlen=STAMPS))
    repeats: int = 0

    def note(
        self, frame: str, stamp: float, *, now: float, clock: float, again: bool = False
    ) -> None:
        """Take note of a message.

        Args:
            frame: of its header.
            stamp: of its header, seconds.
            now: monotonic seconds.
            clock: the node's, seconds.
            again: whether it is the one before with another stamp.
        """
        self.count, self.heard, self.stamp = self.count + 1, now, stamp
        self.frames.append(frame)
        self.behind.append(clock - stamp)
        self.repeats = self.repeats + 1 if again else 0

    @property
    def frame(self) -> str:
        """Of the last message; empty before it."""
        return self.frames[-1] if self.frames else ''

    @property
    def lag(self) -> float:
        """Seconds from a message's stamp to its arrival, of late; 0 before the first."""
        return median(self.behind) if self.behind else 0.0

    def silence(self, now: float) -> float:
        """Seconds since the last message."""
        return now - (self.began if self.heard is None else self.heard)

    def warnings(self, now: float, limits: Limits, wires: Wires | None = None) -> list[str]:
        """What is odd about it.

        Args:
            now: monotonic seconds.
            limits: when to warn.
            wires: what the graph says of it.
        """
        found = []
        if (quiet := self.silence(now)) > limits.silence:
            why = wires.silent(self.kind, limits.reliable) if wires else ''
            found.append(f'silent for {quiet:.1f} s{": " if why else ""}{why}')
        if wires and wires.several:
            found.append(f'has {wires.several}')
        if len(frames := sorted(set(self.frames))) > 1:
            names = ', '.join(map(repr, frames))
            found.append(f'mixes the frames {names}: do several drivers publish on it?')
        if self.repeats >= HANGS:
            found.append('sends one cloud again and again with new stamps: does its driver hang?')
        if clock := self.clock(limits.max_age):
            found.append(clock)
        return [f'{self.topic} {what}' for what in found]

    def clock(self, late: float) -> str:
        """What is wrong with its stamps; empty if nothing is."""
        return another_clock(self.stamp, self.lag, late) if self.behind else ''


def of_frames(streams: Sequence[Stream]) -> list[str]:
    """What is odd about the frames of clouds, which the transforms are between."""
    found = []
    for stream in streams:
        if stream.frames and not stream.frame:
            found.append(f'{stream.topic} has an empty frame_id: set one in its driver')
        if stream.frame.startswith('/'):
            found.append(
                f'{stream.topic} has the frame {stream.frame!r}: tf2 refuses the slash in front'
            )
    frames = {stream.frame for stream in streams}
    if len(frames) == 1 and '' not in frames:
        found.append(f'both clouds are in frame {frames.pop()!r}: give each LiDAR one of its own')
    return found
