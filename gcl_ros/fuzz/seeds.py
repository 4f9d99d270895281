"""Small whole inputs of every format, for the fuzzers to break."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml

from gcl_core import se3
from gcl_core.compact.scan import CompactConfig, encode
from gcl_core.data.clouds import write_cloud
from gcl_core.data.pair_list import PairList, listed, write_pair_list
from gcl_core.estimation.confidence import load_calibration
from gcl_core.models import zoo
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.registrar import RegistrarConfig
from gcl_core.training import checkpoint
from gcl_core.types import PointCloud
from gcl_ros.bag import ODOMETRY, Encounter, encounter_messages, write_bag
from gcl_ros.bag_reader import message_types
from gcl_ros.compact_cloud import fill_compact

TINY = ResUNetConfig(encoder=(2, 2, 2, 2), decoder=(2, 2, 2), head=2, descriptor=2)
POSE = '1 0 0 0.5 0 1 0 -2 0 0 1 3e-1\n'


def cloud(count: int = 40) -> PointCloud:
    """A few points."""
    return PointCloud(np.random.default_rng(0).normal(0, 9, (count, 3)).astype(np.float32))


def network(seed: int = 0) -> Any:
    """A network of a few weights."""
    torch.manual_seed(seed)
    return zoo.build(TINY)


def state() -> checkpoint.State:
    """What a checkpoint of such a network holds, after one step."""
    model = network()
    optimizer = torch.optim.SGD(model.parameters(), lr=0.1, momentum=0.8)
    sum(p.sum() for p in model.parameters()).backward()
    optimizer.step()
    return checkpoint.State(model, optimizer, None)


def file_of(name: str, write: Callable[[Path], object]) -> bytes:
    """Bytes of the file that `write` makes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


@cache
def bag(storage: Any) -> tuple[bytes, bytes]:
    """Metadata and storage of a small bag."""
    encounters = [Encounter(1.0 + i, cloud(), cloud(30), np.eye(4)) for i in range(2)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'bag'
        write_bag(path, encounters, storage)
        (data,) = (f for f in path.iterdir() if f.suffix != '.yaml')
        return (path / 'metadata.yaml').read_bytes(), data.read_bytes()


@cache
def raw_message() -> bytes:
    """A PointCloud2 of points, serialized."""
    types = message_types()
    encounter = Encounter(1.0, cloud(), cloud(), np.eye(4))
    message = [m for _, m in encounter_messages(types, encounter, 10**9)][1]
    return bytes(types.serialize_cdr(message, message.__msgtype__))


@cache
def odometry() -> bytes:
    """A nav_msgs/Odometry, serialized."""
    types, none = message_types(), np.zeros(36)
    make = lambda name, *values: types.types[name](*values)  # noqa: E731
    header = make('std_msgs/msg/Header', make('builtin_interfaces/msg/Time', 1, 0), 'odom')
    zero = make('geometry_msgs/msg/Vector3', 0.0, 0.0, 0.0)
    pose = make(
        'geometry_msgs/msg/Pose',
        make('geometry_msgs/msg/Point', 1.0, 2.0, 3.0),
        make('geometry_msgs/msg/Quaternion', 0.0, 0.0, 0.0, 1.0),
    )
    twist = make('geometry_msgs/msg/Twist', zero, zero)
    with_covariance = (
        make('geometry_msgs/msg/PoseWithCovariance', pose, none),
        make('geometry_msgs/msg/TwistWithCovariance', twist, none),
    )
    message = make(ODOMETRY, header, 'base', *with_covariance)
    return bytes(types.serialize_cdr(message, ODOMETRY))


@cache
def compact_message() -> bytes:
    """A PointCloud2 with a compact scan, serialized."""
    types = message_types()
    encounter = Encounter(1.0, cloud(), cloud(), np.eye(4))
    message = [m for _, m in encounter_messages(types, encounter, 10**9)][1]
    fill_compact(message, encode(cloud()), types.types['sensor_msgs/msg/PointField'])
    message.data = np.frombuffer(message.data, np.uint8)
    return bytes(types.serialize_cdr(message, message.__msgtype__))


@cache
def compact_scans() -> list[bytes]:
    """Compact scans: of one voxel, with residuals, of large voxels, of small ones."""
    kinds = (
        (1, CompactConfig()),
        (40, CompactConfig(residual_bits=3)),
        (300, CompactConfig(voxel_size=2.0)),
        (2000, CompactConfig(voxel_size=0.05)),
    )
    return [encode(cloud(size), config) for size, config in kinds]


def pcd(kind: str) -> bytes:
    """A .pcd file, ascii, binary or compressed."""
    import open3d as o3d

    tensor = o3d.t.geometry.PointCloud(o3d.core.Tensor(cloud().points))
    options = {'write_ascii': kind == 'ascii', 'compressed': kind == 'compressed'}
    return file_of('c.pcd', lambda p: o3d.t.io.write_point_cloud(str(p), tensor, **options))


def padded_pcd() -> bytes:
    """A .pcd as PCL writes it, with bytes between its fields."""
    table = np.zeros(40, [('xyz', '<f4', 3), ('a', 'V4'), ('intensity', '<f4'), ('b', 'V12')])
    table['xyz'] = cloud().points
    return (
        b'VERSION 0.7\nFIELDS x y z _ intensity _\nSIZE 4 4 4 1 4 1\nTYPE F F F U F U\n'
        b'COUNT 1 1 1 4 1 12\nWIDTH 8\nHEIGHT 5\nPOINTS 40\nDATA binary\n' + table.tobytes()
    )


def rich_ply() -> bytes:
    """A .ply of big-endian doubles behind another element, with more than x, y, z."""
    table = np.zeros(40, [('red', 'u1'), ('xyz', '>f8', 3)])
    table['xyz'] = cloud().points
    return (
        b'ply\nformat binary_big_endian 1.0\nelement camera 2\nproperty float fx\n'
        b'element vertex 40\nproperty uchar red\nproperty double x\nproperty double y\n'
        b'property double z\nend_header\n' + bytes(8) + table.tobytes()
    )


def bin_of_columns() -> bytes:
    """A .bin of five columns of float64."""
    ring = np.arange(40)[:, None] // 4
    return np.hstack([cloud().points, ring % 7 / 7, ring]).astype(float).tobytes()


def ply(kind: str) -> bytes:
    """A .ply file, ascii or binary."""
    import open3d as o3d

    tensor = o3d.t.geometry.PointCloud(o3d.core.Tensor(cloud().points))
    ascii_ = kind == 'ascii'
    return file_of(
        'c.ply', lambda p: o3d.t.io.write_point_cloud(str(p), tensor, write_ascii=ascii_)
    )


def npy() -> bytes:
    """A .npy file."""
    stream = io.BytesIO()
    np.save(stream, cloud().points, allow_pickle=False)
    return stream.getvalue()


@cache
def weights() -> bytes:
    """A weights file."""
    return file_of('w.safetensors', lambda path: zoo.save_weights(path, network(), {}))


def calibration() -> bytes:
    """The shipped calibration."""
    content = asdict(load_calibration(zoo.FOLDER / zoo.SHIPPED))
    return json.dumps({**content, 'record': {}}).encode()


def config() -> bytes:
    """The registrar's settings."""
    plain = json.loads(json.dumps(asdict(RegistrarConfig())))
    return yaml.safe_dump(plain).encode()


def links() -> bytes:
    """ETH's `gt.log`."""
    rows = '\n'.join(' '.join(map(str, row)) for row in se3.from_xyz_rpy(1, 2, 3, yaw=0.5))
    return f'0 1 2\n{rows}\n1 0 2\n{rows}\n'.encode()


def pair_list() -> bytes:
    """A pair list with its hash."""
    pairs = PairList('few', listed('08', [(0, 1), (1, 0)]), (10, 20), ('a note',))
    return file_of('pairs.txt', lambda path: write_pair_list(path, pairs))


def nuscenes() -> dict[str, list[dict[str, Any]]]:
    """One key frame in nuScenes' tables."""
    pose = {'rotation': [1.0, 0.0, 0.0, 0.0], 'translation': [1.0, 2.0, 0.5]}
    frame: dict[str, Any] = {'token': 'f', 'is_key_frame': True, 'timestamp': 1_500_000}
    frame |= {'filename': 'samples/LIDAR_TOP/f.pcd.bin', 'sample_token': 's'}
    frame |= {'ego_pose_token': 'e', 'calibrated_sensor_token': 'c'}
    return {
        'sample_data': [frame],
        'ego_pose': [{'token': 'e', **pose}],
        'calibrated_sensor': [{'token': 'c', **pose}],
        'sample': [{'token': 's', 'scene_token': 'n'}],
        'scene': [{'token': 'n', 'log_token': 'l'}],
        'log': [{'token': 'l', 'logfile': 'drive'}],
    }


def bin_file() -> bytes:
    """KITTI's .bin."""
    return file_of('c.bin', lambda path: write_cloud(path, cloud()))
