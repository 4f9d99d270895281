"""What is fuzzed: each reader, with whole inputs to start from."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gcl_core.compact.scan import CHECKSUM, HEADER, SIZE, decode
from gcl_core.config import load_config
from gcl_core.data.clouds import read_cloud
from gcl_core.data.eth import read_links
from gcl_core.data.kitti import read_calibration
from gcl_core.data.nuscenes import read_logs
from gcl_core.data.pair_list import read_pair_list
from gcl_core.data.poses import read_poses
from gcl_core.estimation.confidence import load_calibration
from gcl_core.models import zoo
from gcl_core.registrar import RegistrarConfig
from gcl_core.training import checkpoint
from gcl_core.training.recipe import TrainConfig
from gcl_ros.bag import CLOUD, ODOMETRY, read_encounters
from gcl_ros.bag_info import summary
from gcl_ros.bag_reader import cloud_of, deserialized
from gcl_ros.bag_sequence import BagSequence
from gcl_ros.compact_cloud import is_compact
from gcl_ros.conversions import pose_matrix
from gcl_ros.deskew import deskewed
from gcl_ros.fuzz import seeds
from gcl_ros.odometry import Odometry

Read = Callable[[bytes, Path], object]  # an input, and a folder that is the reader's own


@dataclass(frozen=True)
class Target:
    """A reader and whole inputs for it."""

    seeds: Callable[[], list[bytes]]
    read: Read


def put(path: Path, data: bytes) -> None:
    """Write a file anew: to cut one off and fill it again waits for the disk, 6 ms on ext4."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


def _message(data: bytes, _: Path) -> None:
    """A cloud as it comes over the wire or lies in a bag."""
    message = deserialized(data, CLOUD)
    if not is_compact(message):
        deskewed(message, Odometry())
    cloud_of(message)


def _compact(data: bytes, _: Path) -> None:
    """A compact scan, its checksum made to fit: else nothing behind it would be reached."""
    head, body = data[: HEADER.size], data[SIZE:]
    decode(head + CHECKSUM.pack(zlib.crc32(body, zlib.crc32(head))) + body)


def _odometry(data: bytes, _: Path) -> None:
    """A vehicle's pose."""
    pose_matrix(deserialized(data, ODOMETRY).pose.pose)


def _file(name: str, read: Callable[[Path], object]) -> Read:
    def from_bytes(data: bytes, folder: Path) -> object:
        path = folder / name
        put(path, data)
        return read(path)

    return from_bytes


def _bag(part: str, storage: str) -> Read:
    """A bag with either its metadata or its storage broken."""
    name = 'bag.mcap' if storage == 'mcap' else 'bag.db3'
    whole = dict(zip(('metadata.yaml', name), seeds.bag(storage), strict=True))

    def from_bytes(data: bytes, folder: Path) -> None:
        files = whole | {'metadata.yaml' if part == 'metadata' else name: data}
        for file, content in files.items():
            put(folder / file, content)
        summary(folder)
        list(read_encounters(folder))
        BagSequence(folder, topic='/source/points').scan(0)

    return from_bytes


def _weights(data: bytes, folder: Path) -> None:
    path = folder / 'w.safetensors'
    put(path, data)
    zoo.load_weights(str(path))


def _record(data: bytes, folder: Path) -> None:
    """Weights whose record is broken."""
    put(folder / 'w.json', data)
    _weights(seeds.weights(), folder)


def _checkpoint(path: Path) -> None:
    checkpoint.load(path, seeds.state())


def _nuscenes(data: bytes, folder: Path) -> None:
    """All tables in one text, a line each."""
    tables = folder / 'v1.0-mini'
    tables.mkdir(exist_ok=True)
    lines = data.split(b'\n')
    for name, line in zip(seeds.nuscenes(), lines, strict=False):
        put(tables / f'{name}.json', line)
    for sequence in read_logs(folder).values():
        sequence.T_world_lidar(0)


def _tables() -> list[bytes]:
    return ['\n'.join(json.dumps(table) for table in seeds.nuscenes().values()).encode()]


def targets() -> dict[str, Target]:
    """Every target by its name."""
    found: dict[str, Target] = {
        'message': Target(lambda: [seeds.raw_message(), seeds.compact_message()], _message),
        'compact scan': Target(seeds.compact_scans, _compact),
        'odometry': Target(lambda: [seeds.odometry()], _odometry),
        'weights': Target(lambda: [seeds.weights()], _weights),
        'weights record': Target(lambda: [b'{"sha256": "0"}'], _record),
        'nuscenes': Target(_tables, _nuscenes),
    }
    for storage in ('mcap', 'sqlite3'):
        metadata, data = seeds.bag(storage)
        found[f'bag {storage}'] = Target(partial(list, [data]), _bag('storage', storage))
        found[f'bag {storage} metadata'] = Target(
            partial(list, [metadata]), _bag('metadata', storage)
        )
    for name, read, make in _files():
        found[name] = Target(make, _file(name, read))
    return found


def _files() -> list[tuple[str, Callable[[Path], object], Callable[[], list[bytes]]]]:
    """Readers of one file each."""
    pcds = lambda: [  # noqa: E731
        *(seeds.pcd(kind) for kind in ('ascii', 'binary', 'compressed')),
        seeds.padded_pcd(),
    ]
    plys = lambda: [seeds.ply('ascii'), seeds.ply('binary'), seeds.rich_ply()]  # noqa: E731
    steps = lambda: [  # noqa: E731
        seeds.file_of('c', lambda path: checkpoint.save(path, seeds.state(), 3, {}))
    ]
    return [
        ('c.pcd', read_cloud, pcds),
        ('c.ply', read_cloud, plys),
        ('c.bin', read_cloud, lambda: [seeds.bin_file(), seeds.bin_of_columns()]),
        ('c.npy', read_cloud, lambda: [seeds.npy()]),
        ('c.gcl', read_cloud, seeds.compact_scans),
        ('registrar.yaml', partial(load_config, RegistrarConfig), lambda: [seeds.config()]),
        ('train.yaml', partial(load_config, TrainConfig), lambda: [b'seed: 1\nsteps: 10\n']),
        ('checkpoint.safetensors', _checkpoint, steps),
        ('w.calibration.json', load_calibration, lambda: [seeds.calibration()]),
        ('poses.txt', read_poses, lambda: [3 * seeds.POSE.encode()]),
        ('calib.txt', read_calibration, lambda: [f'P0: 1\nTr: {seeds.POSE}'.encode()]),
        ('gt.log', partial(read_links, count=2), lambda: [seeds.links()]),
        ('pairs.txt', read_pair_list, lambda: [seeds.pair_list()]),
    ]
