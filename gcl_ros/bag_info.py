"""What is in a bag: topics with their rates and frames; of our own bags the pairs, too."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from gcl_core import se3
from gcl_core.data.pairs import BINS
from gcl_ros.bag import CLOUD, SOURCE, TARGET, TRUTH, pair_list_label
from gcl_ros.bag_reader import open_bag
from gcl_ros.bag_sequence import POSES
from gcl_ros.conversions import matrix, seconds

READ = {CLOUD, *POSES}  # types whose headers are looked at


def summary(path: Path) -> str:
    """Describe a bag in a few lines.

    Raises:
        GclError: missing or damaged.
    """
    stamps: dict[str, list[float]] = defaultdict(list)
    frames: dict[str, set[str]] = defaultdict(set)
    points: dict[str, list[int]] = defaultdict(list)
    truths = []
    with open_bag(path) as bag:
        kinds = {c.topic: c.msgtype for c in bag.connections}
        counts = {c.topic: 0 for c in bag.connections}
        for c in bag.connections:
            counts[c.topic] += c.msgcount
        head = f'{path}: {bag.message_count} messages, {bag.duration * 1e-9:.1f} s'
        looked_at = [c for c in bag.connections if c.msgtype in READ]
        for connection, _, message in bag.messages(looked_at):
            stamps[connection.topic].append(seconds(message.header.stamp))
            frames[connection.topic].add(message.header.frame_id)
            if connection.msgtype == CLOUD:
                points[connection.topic].append(message.width * message.height)
            if connection.topic == TRUTH:
                truths.append(matrix(message.transform))
    lines = [head]
    for topic in sorted(kinds):
        text = f'  {topic}  {kinds[topic]}  {counts[topic]} messages'
        if stamps[topic]:
            text += f', {_rate(stamps[topic])}frame {", ".join(sorted(frames[topic]))!r}'
        if points[topic]:
            text += f', {int(np.median(points[topic])):,} points'
        lines.append(text)
    if {SOURCE, TARGET, TRUTH} <= set(kinds):
        lines += [f'  pairs: {pair_list_label(path)}', *_distances(truths)]
    return '\n'.join(lines)


def _rate(stamps: list[float]) -> str:
    steps = np.diff(np.sort(stamps))
    steps = steps[steps > 0]
    return f'{1 / np.median(steps):.1f} Hz, ' if len(steps) else ''


def _distances(truths: Iterable[np.ndarray]) -> list[str]:
    """How many pairs are how far apart, and how they are turned."""
    where = [(float(np.linalg.norm(T[:3, 3])), abs(float(np.rad2deg(se3.yaw(T))))) for T in truths]
    lines = []
    for low, high in [*BINS, (BINS[-1][1], 10**6)]:
        yaws = [yaw for distance, yaw in where if low <= distance < high]
        if yaws:
            until = f'{low}–{high} m' if high < 10**6 else f'over {low} m'
            lines.append(f'    {until}: {len(yaws)} pairs, headings up to {max(yaws):.0f}° apart')
    return lines
