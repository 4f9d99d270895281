"""A bag whose clouds become compact scans; everything else in it stays what it is."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag2 import StoragePlugin, Writer

from gcl_core.compact.scan import CompactConfig, encode
from gcl_core.errors import GclError
from gcl_core.files import whole_folder
from gcl_core.progress import progress
from gcl_core.types import PointCloud
from gcl_ros.bag import CLOUD, VERSION
from gcl_ros.bag_reader import Bag, bag_at, deserialized, message_types, open_bag
from gcl_ros.bag_sequence import BagSequence
from gcl_ros.compact_cloud import fill_compact, is_compact
from gcl_ros.conversions import point_cloud, seconds
from gcl_ros.deskew import deskewed
from gcl_ros.odometry import Odometry
from gcl_ros.point_times import LONGEST, TIMES

UNKNOWN_HASH = f'RIHS01_{"0" * 64}'  # of a type that neither the bag nor rosbags knows


@dataclass
class PackedTopic:
    """What became of a topic of clouds.

    Attributes:
        name: such as `/source/points`.
        packed: clouds that became compact scans.
        before: bytes of the points of these.
        after: bytes of their compact scans.
        left: clouds that stayed as they were.
        why: the first of these did.
        timed: clouds whose points told when they were seen, which compact scans do not.
        straightened: of these, de-skewed first.
        bent: why the first of the others was not.
    """

    name: str
    packed: int = 0
    before: int = 0
    after: int = 0
    left: int = 0
    why: str = ''
    timed: int = 0
    straightened: int = 0
    bent: str = ''


@dataclass
class PackedBag:
    """What became of a bag.

    Attributes:
        path: of what was written.
        messages: how many.
        before: bytes of the bag.
        after: bytes of what was written.
        topics: of clouds.
    """

    path: Path
    messages: int = 0
    before: int = 0
    after: int = 0
    topics: list[PackedTopic] = field(default_factory=list)


class Packer:
    """Packs the clouds of a topic.

    Args:
        path: of the bag.
        name: of the topic.
        config: how much of a cloud is kept.
        odometry: topic of poses to de-skew by, if any.

    Raises:
        GclError: the bag has no such poses, or none of the clouds' frame.
    """

    def __init__(self, path: Path, name: str, config: CompactConfig, odometry: str | None) -> None:
        self.topic, self._config = PackedTopic(name), config
        self._odometry, self._coming = None, iter(())
        if odometry:
            self._odometry = Odometry()
            self._coming = BagSequence(path, topic=name, pose_topic=odometry).track()
        self._next = next(self._coming, None)

    def packed(self, raw: bytes) -> bytes:
        """A cloud as a compact scan; as it is where it is one, or none can be made of it."""
        topic, types = self.topic, message_types()
        try:
            message = deserialized(raw, CLOUD)
            if is_compact(message):
                raise GclError('it is compact already')
            data = encode(self._cloud(message), self._config)
        except GclError as error:
            topic.left, topic.why = topic.left + 1, topic.why or str(error)
            return raw
        topic.packed += 1
        topic.before += len(message.data)
        topic.after += len(data)
        fill_compact(message, data, types.types['sensor_msgs/msg/PointField'])
        message.data = np.frombuffer(message.data, np.uint8)
        return bytes(types.serialize_cdr(message, CLOUD))

    def _cloud(self, message: Any) -> PointCloud:
        """De-skewed where that is asked for and can be."""
        cloud, topic = point_cloud(message), self.topic
        if not any(field.name in TIMES for field in message.fields):
            return cloud
        topic.timed += 1
        if self._odometry is None:
            topic.bent = 'name a topic of poses, --odometry'
            return cloud
        while self._next and self._next[0] < seconds(message.header.stamp) + LONGEST:
            self._odometry.add(*self._next)
            self._next = next(self._coming, None)
        swept = deskewed(message, self._odometry)
        topic.straightened += swept.cloud is not None
        topic.bent = topic.bent or swept.why
        return swept.cloud or cloud


def pack_bag(
    path: Path,
    out: Path,
    config: CompactConfig,
    *,
    topics: Collection[str] = (),
    odometry: str | None = None,
    storage: Literal['mcap', 'sqlite3'] = 'mcap',
) -> PackedBag:
    """Write a bag anew with compact scans for its clouds, in the same order, under the same names.

    Headers, times of writing, qualities of service and the bag's custom data are kept. A cloud
    that cannot be read, or of which nothing is kept, stays as it is.

    Args:
        path: the bag.
        out: folder to write.
        config: how much of a cloud is kept.
        topics: of clouds to pack; all if none.
        odometry: topic of poses, by which clouds are de-skewed whose points tell their times.
        storage: of what is written.

    Raises:
        GclError: the bag is damaged, there is nothing to pack, or `out` is there already or cannot
            be written.
    """
    found = PackedBag(out)
    with whole_folder(out) as part:
        with open_bag(path) as bag:
            chosen = _chosen(bag, path, topics)
            packers = {name: Packer(path, name, config, odometry) for name in chosen}
            found.messages = _write(bag, part, packers, storage)
        found.topics = [packer.topic for packer in packers.values()]
        if not any(topic.packed for topic in found.topics):
            why = next((topic.why for topic in found.topics if topic.why), 'no cloud came')
            raise GclError(f'bag {path}: no cloud of {", ".join(chosen)} was packed: {why}')
        found.before, found.after = _bytes(bag_at(path)), _bytes(part)
    return found


def in_words(found: PackedBag) -> str:
    """A few lines."""
    lines = [
        f'{found.path}: {found.messages} messages, {found.after:,} bytes instead of '
        f'{found.before:,}: 1/{found.before / found.after:.0f}'
    ]
    for topic in found.topics:
        text = f'  {topic.name}  {topic.packed} clouds packed'
        if topic.packed:
            mean, before = topic.after / topic.packed, topic.before / topic.packed
            text += f', {mean:,.0f} bytes on average instead of {before:,.0f}'
        if topic.left:
            text += f'; {topic.left} stay as they were: {topic.why}'
        lines.append(text)
        if topic.straightened:
            lines.append(f'    {topic.straightened} of them de-skewed first')
        if topic.timed > topic.straightened:
            lines.append(
                f'    {topic.timed - topic.straightened} of them can no longer be de-skewed, as '
                f'the times of their points are gone: {topic.bent}'
            )
    return '\n'.join(lines)


def _chosen(bag: Bag, path: Path, wanted: Collection[str]) -> list[str]:
    """Topics of clouds to pack."""
    clouds = sorted({c.topic for c in bag.connections if c.msgtype == CLOUD})
    missing = sorted(set(wanted) - set(clouds))
    if missing or not clouds:
        known = ', '.join(clouds) or f'none of {CLOUD}'
        told = f'has no topic of clouds {", ".join(missing)}' if missing else 'holds no clouds'
        raise GclError(f'bag {path} {told}; it has {known}')
    return sorted(set(wanted)) or clouds


def _write(bag: Bag, part: Path, packers: dict[str, Packer], storage: str) -> int:
    """Copy every message, clouds packed; returns how many."""
    plugin = StoragePlugin.MCAP if storage == 'mcap' else StoragePlugin.SQLITE3
    count = 0
    with Writer(part, version=VERSION, storage_plugin=plugin) as writer:
        for key, value in bag.custom.items():
            writer.set_custom_data(str(key), str(value))
        copies: dict[Any, Connection] = {}
        for c in bag.connections:
            if _key(c) not in copies:
                copies[_key(c)] = _copied(writer, c)
        messages = progress(bag.raw(), total=bag.message_count, unit='message')
        for connection, written, raw in messages:
            packer = packers.get(connection.topic) if connection.msgtype == CLOUD else None
            data = packer.packed(bytes(raw)) if packer else bytes(raw)
            writer.write(copies[_key(connection)], written, data)
            count += 1
    return count


def _key(connection: Connection) -> tuple[str, str, str]:
    """What a bag may hold once."""
    return connection.topic, connection.msgtype, repr(connection.ext)


def _copied(writer: Writer, c: Connection) -> Connection:
    """The same topic in another bag: with the bag's own definition of its type, if it has one."""
    types, own = message_types(), c.msgdef.format != MessageDefinitionFormat.NONE
    known = c.msgtype in types.fielddefs
    told: dict[str, Any] = {'typestore': types}
    if not known or (own and c.digest):
        told = {'msgdef': c.msgdef.data, 'rihs01': c.digest or UNKNOWN_HASH}
    return writer.add_connection(
        c.topic,
        c.msgtype,
        **told,
        serialization_format=c.ext.serialization_format,
        offered_qos_profiles=c.ext.offered_qos_profiles,
    )


def _bytes(path: Path) -> int:
    """Bytes of a bag on the disk."""
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
