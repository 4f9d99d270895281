"""What is in a bag: topics with their rates and frames; of our own bags the pairs, too."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.data.pairs import BINS
from gcl_core.errors import GclError
from gcl_core.progress import progress
from gcl_ros.bag import CLOUD, SOURCE, TARGET, TRUTH, pair_list_label
from gcl_ros.bag_reader import open_bag
from gcl_ros.bag_sequence import POSES
from gcl_ros.compact_cloud import compact_header, is_compact
from gcl_ros.conversions import matrix, seconds

READ = {CLOUD, *POSES}  # types whose headers are looked at


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: such as `/source/points`.
        kind: type of its messages.
        messages: how many.
        hertz: by the stamps in the headers; None where there are too few, or no headers.
        frames: frame ids of the headers.
        points: median of its clouds, voxels of compact ones; None of other messages.
        compact_bytes: mean of its compact scans; None where there are none.
    """

    name: str
    kind: str
    messages: int
    hertz: float | None
    frames: tuple[str, ...]
    points: int | None
    compact_bytes: float | None


@dataclass(frozen=True)
class BagInfo:
    """What is in a bag.

    Attributes:
        path: of the bag.
        messages: how many.
        seconds: from the first to the last.
        topics: by name.
        pair_list: label of the pairs; None in a bag that is not ours.
        pairs: for each pair how far apart, metres, and by how much turned, degrees.
    """

    path: Path
    messages: int
    seconds: float
    topics: tuple[Topic, ...]
    pair_list: str | None
    pairs: tuple[tuple[float, float], ...]


def look(path: Path) -> BagInfo:
    """Read a bag through.

    Raises:
        GclError: missing or damaged.
    """
    stamps: dict[str, list[float]] = defaultdict(list)
    frames: dict[str, set[str]] = defaultdict(set)
    points: dict[str, list[int]] = defaultdict(list)
    sizes: dict[str, list[int]] = defaultdict(list)
    pairs = []
    with open_bag(path) as bag:
        kinds = {c.topic: c.msgtype for c in bag.connections}
        counts = {c.topic: 0 for c in bag.connections}
        for c in bag.connections:
            counts[c.topic] += c.msgcount
        messages, duration = bag.message_count, bag.duration * 1e-9
        looked_at = [c for c in bag.connections if c.msgtype in READ]
        read = progress(bag.messages(looked_at), unit='message')
        for connection, _, message in read:
            stamps[connection.topic].append(seconds(message.header.stamp))
            frames[connection.topic].add(message.header.frame_id)
            if connection.msgtype == CLOUD:
                count, size = _counted(message)
                points[connection.topic] += count
                sizes[connection.topic] += size
            if connection.topic == TRUTH:
                T = matrix(message.transform)
                yaw_deg = abs(float(np.rad2deg(se3.yaw(T))))
                pairs.append((float(np.linalg.norm(T[:3, 3])), yaw_deg))
    topics = tuple(
        Topic(
            name,
            kinds[name],
            counts[name],
            _hertz(stamps[name]),
            tuple(sorted(frames[name])),
            int(np.median(points[name])) if points[name] else None,
            float(np.mean(sizes[name])) if sizes[name] else None,
        )
        for name in sorted(kinds)
    )
    ours = {SOURCE, TARGET, TRUTH} <= set(kinds)
    label = pair_list_label(path) if ours else None
    return BagInfo(path, messages, duration, topics, label, tuple(pairs) if ours else ())


def summary(path: Path) -> str:
    """Describe a bag in a few lines; errors as `look`."""
    return in_words(look(path))


def in_words(info: BagInfo) -> str:
    """A few lines."""
    lines = [f'{info.path}: {info.messages} messages, {info.seconds:.1f} s']
    for topic in info.topics:
        text = f'  {topic.name}  {topic.kind}  {topic.messages} messages'
        text += f', {topic.hertz:.1f} Hz' if topic.hertz else ''
        text += f', frame {", ".join(topic.frames)!r}' if topic.frames else ''
        if topic.compact_bytes is not None:
            text += f', compact, {topic.compact_bytes:,.0f} bytes on average'
        what = 'points' if topic.compact_bytes is None else 'voxels'
        lines.append(text + (f', {topic.points:,} {what}' if topic.points is not None else ''))
    if info.pair_list is not None:
        lines += [f'  pairs: {info.pair_list}', *_distances(info.pairs)]
    return '\n'.join(lines)


def _counted(message: Any) -> tuple[list[int], list[int]]:
    """Points of a cloud, and bytes of a compact one; neither where that is damaged."""
    if not is_compact(message):
        return [message.width * message.height], []
    try:
        return [compact_header(message).count], [len(message.data)]
    except GclError:
        return [], []


def _hertz(stamps: list[float]) -> float | None:
    steps = np.diff(np.sort(stamps))
    steps = steps[steps > 0]
    return float(1 / np.median(steps)) if len(steps) else None


def _distances(pairs: Iterable[tuple[float, float]]) -> list[str]:
    """How many pairs are how far apart, and how they are turned."""
    lines = []
    for low, high in [*BINS, (BINS[-1][1], 10**6)]:
        yaws = [yaw for distance, yaw in pairs if low <= distance < high]
        if yaws:
            until = f'{low}–{high} m' if high < 10**6 else f'over {low} m'
            lines.append(f'    {until}: {len(yaws)} pairs, headings up to {max(yaws):.0f}° apart')
    return lines
