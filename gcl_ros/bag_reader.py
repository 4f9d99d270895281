"""A rosbag2 that may be damaged: whatever goes wrong in reading it comes out as one GclError."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from gcl_core.errors import GclError
from gcl_core.types import PointCloud
from gcl_ros.bag_remedies import SUFFIXES, reason, storage_files
from gcl_ros.compact_cloud import compact_cloud, is_compact
from gcl_ros.conversions import point_cloud

STORE = Stores.ROS2_HUMBLE  # the messages used here are the same from Humble to Kilted


@cache
def message_types() -> Any:
    """All message types of `STORE`; made once, in tenths of a second."""
    return get_typestore(STORE)


@contextmanager
def _refused(what: str) -> Iterator[None]:
    """Around calls of rosbags alone: damaged input makes it fail in a dozen ways."""
    try:
        yield
    except (Exception, MemoryError) as error:
        told = str(error) or type(error).__name__
        raise GclError(f'cannot read {what}: {told[:500]}; is it damaged or cut off?') from None


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """The same of a bag, with what helps."""
    try:
        yield
    except (Exception, MemoryError) as error:
        raise GclError(f'cannot read bag {path}: {reason(error, path)}') from None


def deserialized(raw: Any, kind: str) -> Any:
    """A message from its bytes.

    Raises:
        GclError: they are damaged, or the type is none of ROS's own.
    """
    with _refused(f'a message of type {kind}'):
        return message_types().deserialize_cdr(raw, kind)


def cloud_of(message: Any) -> PointCloud:
    """A cloud, raw or compact.

    Args:
        message: sensor_msgs/PointCloud2.

    Raises:
        GclError: as `point_cloud` or `compact_cloud`.
    """
    return compact_cloud(message) if is_compact(message) else point_cloud(message)


class Bag:
    """A bag that is open.

    Attributes:
        connections: topics with their types.
        message_count: of all topics.
        start_time: of the first message, nanoseconds.
        end_time: of the last.
        duration: between them.
        custom: data of whoever wrote it.
    """

    def __init__(self, path: Path, reader: Reader) -> None:
        self._path, self._reader = path, reader
        with _readable(path):
            self.connections = list(reader.connections)
            self.message_count, self.duration = int(reader.message_count), int(reader.duration)
            self.start_time, self.end_time = int(reader.start_time), int(reader.end_time)
            self.custom = dict(reader.storage.metadata.custom or {})
        for c in self.connections:
            if not (isinstance(c.topic, str) and isinstance(c.msgtype, str)) or (
                not isinstance(c.msgcount, int)
            ):
                raise GclError(f'cannot read bag {path}: a topic in metadata.yaml is damaged')

    def raw(
        self, connections: Collection[Connection] = (), **span: int
    ) -> Iterator[tuple[Connection, int, Any]]:
        """Connection, time of writing in nanoseconds, and bytes of each message.

        Args:
            connections: all if none.
            span: `start` and `stop`, nanoseconds.
        """
        messages = None
        while True:
            with _readable(self._path):
                messages = messages or self._reader.messages(connections, **span)
                found = next(messages, None)
            if found is None:
                return
            yield found

    def messages(
        self, connections: Collection[Connection], **span: int
    ) -> Iterator[tuple[Connection, int, Any]]:
        """The same with messages instead of bytes; of these connections only."""
        for connection, written, raw in self.raw(connections, **span) if connections else ():
            yield connection, written, deserialized(raw, connection.msgtype)


def bag_at(path: Path) -> Path:
    """What stands for a bag: its folder, or a file of messages that no metadata.yaml lists.

    Raises:
        GclError: there is none.
    """
    if not path.exists():
        raise GclError(f'cannot read bag {path}: it does not exist')
    if path.is_dir():
        if (path / 'metadata.yaml').is_file():
            return path
        files = storage_files(path)
        if len(files) == 1:
            return files[0]
        raise GclError(
            f'cannot read bag {path}: no metadata.yaml in it, and {len(files)} files '
            f'{" or ".join(SUFFIXES)}; is it a rosbag2 folder? '
            f'If so, `ros2 bag reindex {path}`, or name one file'
        )
    listing = path.resolve().with_name('metadata.yaml')
    listed = listing.is_file() and path.name in listing.read_text(errors='replace')
    return path.resolve().parent if listed else path


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a rosbag2 folder, or a file of messages.

    Raises:
        GclError: missing or damaged.
    """
    path, reader = bag_at(path), None
    with _readable(path):
        reader = Reader(path)
        reader.open()
    try:
        yield Bag(path, reader)
    finally:
        reader.close()
