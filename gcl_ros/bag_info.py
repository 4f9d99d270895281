"""What is in a bag: topics with their rates and frames; of our own bags the pairs, too."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import get_typestore

from gcl_core import se3
from gcl_core.data.pairs import BINS
from gcl_ros.bag import SOURCE, STORE, TARGET, TRUTH, open_bag, pair_list_label
from gcl_ros.bag_sequence import CLOUD, POSES
from gcl_ros.conversions import matrix, seconds

READ = {CLOUD, *POSES}  # types whose headers are looked at


def summary(path: Path) -> str:
    """Describe a bag in a few lines.

    Raises:
        GclError: missing or damaged.
    """
    types = get_typestore(STORE)
    stamps: dict[str, list[float]] = defaultdict(list)
    frames: dict[str, set[str]] = defaultdict(set)
    points: dict[str, list[int]] = defaultdict(list)
    truths = []
    with open_bag(path) as reader:
        kinds = {c.topic: c.msgtype for c in reader.connections}
        counts = {name: info.msgcount for name, info in reader.topics.items()}
        head = f'{path}: {reader.message_count} messages, {reader.duration * 1e-9:.1f} s'
        looked_at = [c for c in reader.connections if c.msgtype in READ]
        for connection, _, raw in reader.messages(looked_at) if looked_at else ():
            message: Any = types.deserialize_cdr(raw, connection.msgtype)
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
