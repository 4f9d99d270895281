"""A rosbag2 as a drive: clouds, raw or compact, with poses from odometry or transforms."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import PointCloud
from gcl_ros.bag import CLOUD, ODOMETRY
from gcl_ros.bag_reader import Bag, bag_at, cloud_of, open_bag
from gcl_ros.conversions import matrix, pose_matrix, seconds
from gcl_ros.odometry import MAX_GAP, interpolated

STATIC, TRANSFORMS = '/tf_static', 'tf2_msgs/msg/TFMessage'


@dataclass(frozen=True)
class Track:
    """Poses of one frame over time.

    Attributes:
        child: the frame whose poses these are; empty where the messages do not say.
        stamps: seconds, rising.
        poses: in the world.
    """

    child: str
    stamps: Float[np.ndarray, ' n']
    poses: Float[np.ndarray, 'n 4 4']

    def at(self, stamp: float) -> Float[np.ndarray, '4 4']:
        """Interpolate.

        Raises:
            GclError: the time lies outside the track or in a gap of it.
        """
        after = int(np.searchsorted(self.stamps, stamp))
        if after < len(self.stamps) and self.stamps[after] == stamp:
            return self.poses[after]
        if not 0 < after < len(self.stamps):
            raise GclError(
                f'the scan at {stamp:.3f} s lies outside the poses, {self.stamps[0]:.3f} to '
                f'{self.stamps[-1]:.3f} s'
            )
        ends = self.stamps[after - 1 : after + 1]
        if ends[1] - ends[0] > MAX_GAP:
            raise GclError(
                f'the scan at {stamp:.3f} s lies between poses {ends[1] - ends[0]:.2f} s apart'
            )
        return interpolated(stamp, ends, self.poses[after - 1 : after + 1])


class BagSequence:
    """Implements `gcl_core.data.sequence.Sequence`.

    Scans are in order of their header stamps. Poses come from the only topic of nav_msgs/Odometry,
    geometry_msgs/PoseStamped or geometry_msgs/TransformStamped, interpolated to the scan. They are
    poses of the message's child frame: `/tf_static` must link it to the frame of the clouds,
    unless it is that frame. PoseStamped names no child frame: `T_child_lidar` must be given, which
    no command can.

    Args:
        path: folder of the bag, or a file of messages.
        topic: of the clouds; may be left out where there is one.
        pose_topic: may be left out where there is one.
        T_child_lidar: pose of the LiDAR in the child frame, instead of `/tf_static`.

    Raises:
        GclError: missing, damaged, or without such a topic. Missing poses are an error only where
            a pose is asked for.
    """

    def __init__(
        self,
        path: Path,
        *,
        topic: str | None = None,
        pose_topic: str | None = None,
        T_child_lidar: Float[np.ndarray, '4 4'] | None = None,
    ) -> None:
        self._path = bag_at(path)
        self.name = f'bag/{self._path.resolve().name}'
        self._topic = self._choose(topic, (CLOUD,), 'topic of clouds')
        self._pose_topic, self._T_child_lidar = pose_topic, T_child_lidar
        self._frame, self._index = self._read_index()
        self._track: Track | None = None

    def __len__(self) -> int:
        return len(self._index)

    def scan(self, index: int) -> PointCloud:
        """Read one cloud, in its own frame."""
        _, written, place = self._index[index]
        with open_bag(self._path) as bag:
            same = bag.messages(self._of(bag, self._topic), start=written, stop=written + 1)
            for number, (_, _, message) in enumerate(same):
                if number == place:
                    return cloud_of(message)
        raise GclError(f'bag {self._path} has changed since it was opened')

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the LiDAR at the stamp of the scan.

        Raises:
            GclError: the bag has no poses, none around that time, or none of the clouds' frame.
        """
        track, T_child_lidar = self._poses()
        return track.at(self._index[index][0]) @ T_child_lidar

    def track(self) -> Iterator[tuple[float, Float[np.ndarray, '4 4']]]:
        """Stamp and LiDAR pose of each message of poses, by their stamps.

        Raises:
            GclError: the bag has no poses, or none of the clouds' frame.
        """
        track, T_child_lidar = self._poses()
        for stamp, pose in zip(track.stamps.tolist(), track.poses, strict=True):
            yield stamp, pose @ T_child_lidar

    def _poses(self) -> tuple[Track, Float[np.ndarray, '4 4']]:
        if self._track is None:
            self._track = self._read_track()
        if self._T_child_lidar is None:
            self._T_child_lidar = self._mount(self._track.child)
        return self._track, self._T_child_lidar

    def _choose(self, wanted: str | None, kinds: tuple[str, ...], what: str) -> str:
        """The wanted topic, or the only one of these types."""
        with open_bag(self._path) as bag:
            found = sorted({c.topic for c in bag.connections if c.msgtype in kinds})
        if wanted in found:
            return str(wanted)
        if wanted is None and len(found) == 1:
            return found[0]
        known = ', '.join(found) or f'none of {", ".join(kinds)}'
        ask = f'has no {what} {wanted}' if wanted else f'needs one {what}, name it'
        raise GclError(f'bag {self._path} {ask}; it has {known}')

    @staticmethod
    def _of(bag: Bag, topic: str) -> list[Any]:
        """Connections of a topic, of the types that are read here."""
        kinds = (CLOUD, TRANSFORMS, *POSES)
        return [c for c in bag.connections if c.topic == topic and c.msgtype in kinds]

    def _messages(self, topic: str) -> list[Any]:
        """Messages of a small topic."""
        with open_bag(self._path) as bag:
            return [message for _, _, message in bag.messages(self._of(bag, topic))]

    def _read_index(self) -> tuple[str, list[tuple[float, int, int]]]:
        """Frame of the clouds; stamp, time of writing, place among those written then, of each."""
        index, frames, place, previous = [], set(), 0, -1
        with open_bag(self._path) as bag:
            for _, written, message in bag.messages(self._of(bag, self._topic)):
                header = message.header
                place = place + 1 if written == previous else 0
                previous = written
                index.append((seconds(header.stamp), written, place))
                frames.add(header.frame_id)
        if not index:
            raise GclError(f'bag {self._path} holds no message on {self._topic}')
        if len(frames) > 1:
            names = ', '.join(sorted(frames))
            raise GclError(f'bag {self._path}: {self._topic} mixes the frames {names}')
        return frames.pop(), sorted(index)

    def _read_track(self) -> Track:
        topic = self._choose(self._pose_topic, tuple(POSES), 'topic of poses')
        rows = []
        for message in self._messages(topic):
            child, T = POSES[message.__msgtype__](message)
            rows.append((seconds(message.header.stamp), child, T))
        if not rows:
            raise GclError(f'bag {self._path} holds no message on {topic}')
        children = {child for _, child, _ in rows}
        if len(children) > 1:
            raise GclError(f'{topic} mixes the frames {", ".join(sorted(children))}')
        rows.sort(key=lambda row: row[0])
        stamps = np.array([row[0] for row in rows])
        return Track(children.pop(), stamps, np.stack([row[2] for row in rows]))

    def _mount(self, child: str) -> Float[np.ndarray, '4 4']:
        """`T_child_lidar` along `/tf_static`."""
        if child == self._frame:
            return np.eye(4)
        above = {
            t.child_frame_id: (t.header.frame_id, matrix(t.transform))
            for message in self._messages(STATIC)
            for t in message.transforms
        }
        chains = []
        for start in (child, self._frame):
            T, frame, chain = np.eye(4), start, {start: np.eye(4)}
            while frame in above and above[frame][0] not in chain:
                frame, T = above[frame][0], above[frame][1] @ T
                chain[frame] = T
            chains.append(chain)
        shared = next((frame for frame in chains[0] if frame in chains[1]), None)
        if shared is None or not child:
            raise GclError(
                f'bag {self._path}: the poses are of frame {child!r}, the clouds in '
                f'{self._frame!r}, and {STATIC} does not link them; in Python, give T_child_lidar'
            )
        return se3.inverse(chains[0][shared]) @ chains[1][shared]


POSES = {
    ODOMETRY: lambda m: (m.child_frame_id, pose_matrix(m.pose.pose)),
    'geometry_msgs/msg/PoseStamped': lambda m: ('', pose_matrix(m.pose)),
    'geometry_msgs/msg/TransformStamped': lambda m: (m.child_frame_id, matrix(m.transform)),
}
