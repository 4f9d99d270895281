"""Bags of two vehicles: `/target/points`, `/source/points` and the true `/truth/transform`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from rosbags.rosbag2 import StoragePlugin, Writer

from gcl_core import se3
from gcl_core.data.sequence import Sequence, positions
from gcl_core.errors import GclError
from gcl_core.files import whole_folder
from gcl_core.types import PointCloud
from gcl_ros.bag_reader import cloud_of, message_types, open_bag
from gcl_ros.conversions import (
    fill_point_cloud2,
    fill_transform,
    matrix,
    seconds,
)

LATEST = 2**31  # seconds, builtin_interfaces/Time
VERSION = 8  # of the metadata; Humble to Iron cannot read 9
CLOUD, TRANSFORM = 'sensor_msgs/msg/PointCloud2', 'geometry_msgs/msg/TransformStamped'
ODOMETRY = 'nav_msgs/msg/Odometry'
SOURCE, TARGET, TRUTH = '/source/points', '/target/points', '/truth/transform'
PAIR_LIST = 'gcl_pair_list'  # key of the metadata's custom data
FRAMES = {'source': 'source/lidar', 'target': 'target/lidar'}


@dataclass(frozen=True)
class Encounter:
    """Two scans at one moment and where they stand to each other.

    Attributes:
        stamp: seconds.
        source: scan.
        target: scan.
        T_target_source: true transform.
    """

    stamp: float
    source: PointCloud
    target: PointCloud
    T_target_source: Float[np.ndarray, '4 4']


def pair_encounters(
    source: Sequence,
    target: Sequence,
    indices: Iterable[tuple[int, int]],
    period: float,
    *,
    random_yaw_seed: int | None = None,
) -> Iterator[Encounter]:
    """Turn (source, target) scan indices of two drives in one world into encounters.

    Args:
        source: drive of the source vehicle.
        target: drive of the target vehicle.
        indices: scans that meet.
        period: seconds between encounters.
        random_yaw_seed: turn each source scan by a random heading.
    """
    rng = None if random_yaw_seed is None else np.random.default_rng(random_yaw_seed)
    for number, (s, t) in enumerate(indices):
        T = se3.inverse(target.T_world_lidar(t)) @ source.T_world_lidar(s)
        cloud = source.scan(s)
        if rng is not None:
            turn = se3.from_xyz_rpy(yaw=float(rng.uniform(-np.pi, np.pi)))
            cloud, T = PointCloud(se3.transform(turn, cloud.points)), T @ se3.inverse(turn)
        yield Encounter(1.0 + number * period, cloud, target.scan(t), T)


def following(sequence: Sequence, distance: float) -> list[tuple[int, int]]:
    """For every scan as target, the first later scan at least `distance` metres away."""
    where = positions(sequence)
    pairs = []
    for target in range(len(where)):
        apart = np.linalg.norm(where[target:] - where[target], axis=1) >= distance
        if apart.any():
            pairs.append((target + int(apart.argmax()), target))
    if not pairs:
        raise GclError(f'no two scans of {sequence.name} are {distance:g} m apart')
    return pairs


def write_bag(
    path: Path,
    encounters: Iterable[Encounter],
    storage: Literal['mcap', 'sqlite3'] = 'mcap',
    *,
    pair_list: str = 'unlisted pairs',
) -> int:
    """Write encounters; return how many. The bag keeps the label of its pair list.

    It is written beside its place and moved there once it is whole.

    Raises:
        GclError: the folder exists already, or there is no room.
    """
    with whole_folder(path) as part:
        return _write(part, encounters, storage, pair_list)


def _write(path: Path, encounters: Iterable[Encounter], storage: str, pair_list: str) -> int:
    plugin = StoragePlugin.MCAP if storage == 'mcap' else StoragePlugin.SQLITE3
    types = message_types()
    count = 0
    with Writer(path, version=VERSION, storage_plugin=plugin) as writer:
        topics = {
            name: writer.add_connection(name, kind, typestore=types)
            for name, kind in ((SOURCE, CLOUD), (TARGET, CLOUD), (TRUTH, TRANSFORM))
        }
        writer.set_custom_data(PAIR_LIST, pair_list)
        for encounter in encounters:
            if not encounter.stamp < LATEST:
                raise GclError(
                    f'a stamp of {encounter.stamp:g} s is later than ROS can say; '
                    'give a shorter period or fewer pairs'
                )
            stamp = round(encounter.stamp * 1e9)
            for topic, message in encounter_messages(types, encounter, stamp):
                data = types.serialize_cdr(message, message.__msgtype__)
                writer.write(topics[topic], stamp, data)
            count += 1
    return count


def encounter_messages(types: Any, encounter: Encounter, stamp: int) -> Iterator[tuple[str, Any]]:
    """The three messages of an encounter, truth first."""
    t = types.types
    header = lambda frame: t['std_msgs/msg/Header'](  # noqa: E731
        stamp=t['builtin_interfaces/msg/Time'](sec=stamp // 10**9, nanosec=stamp % 10**9),
        frame_id=frame,
    )
    transform = t['geometry_msgs/msg/Transform'](
        translation=t['geometry_msgs/msg/Vector3'](x=0.0, y=0.0, z=0.0),
        rotation=t['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    yield (
        TRUTH,
        t['geometry_msgs/msg/TransformStamped'](
            header=header(FRAMES['target']),
            child_frame_id=FRAMES['source'],
            transform=fill_transform(transform, encounter.T_target_source),
        ),
    )
    for topic, side in ((TARGET, 'target'), (SOURCE, 'source')):
        message = t['sensor_msgs/msg/PointCloud2'](
            header=header(FRAMES[side]),
            height=1,
            width=0,
            fields=[],
            is_bigendian=False,
            point_step=0,
            row_step=0,
            data=np.empty(0, np.uint8),
            is_dense=True,
        )
        points = getattr(encounter, side).points
        fill_point_cloud2(message, points, t['sensor_msgs/msg/PointField'])
        message.data = np.frombuffer(message.data, dtype=np.uint8)
        yield topic, message


def read_encounters(path: Path) -> Iterator[Encounter]:
    """Read what `write_bag` wrote.

    Raises:
        GclError: the bag is missing or damaged, or lacks a topic.
    """
    waiting: dict[str, Any] = {}
    kinds = {SOURCE: CLOUD, TARGET: CLOUD, TRUTH: TRANSFORM}
    with open_bag(path) as bag:
        found = [c for c in bag.connections if kinds.get(c.topic) == c.msgtype]
        missing = set(kinds) - {c.topic for c in found}
        if missing:
            raise GclError(f'bag {path} lacks {", ".join(sorted(missing))}; write it with gcl bag')
        for connection, _, message in bag.messages(found):
            waiting[connection.topic] = message
            if len(waiting) == 3:
                yield Encounter(
                    seconds(waiting[TRUTH].header.stamp),
                    cloud_of(waiting[SOURCE]),
                    cloud_of(waiting[TARGET]),
                    matrix(waiting[TRUTH].transform),
                )
                waiting.clear()


def pair_list_label(path: Path) -> str:
    """Name, size and hash of the pairs in a bag, as `write_bag` was told.

    Raises:
        GclError: the bag is missing or damaged.
    """
    with open_bag(path) as bag:
        label = (bag.custom or {}).get(PAIR_LIST, 'unlisted pairs')
    if not isinstance(label, str):
        raise GclError(f'bag {path}: {PAIR_LIST} in metadata.yaml is no text; write the bag anew')
    return label
