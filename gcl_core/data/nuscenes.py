"""nuScenes: key frames of LIDAR_TOP, through the official JSON tables read directly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.config import read_json
from gcl_core.data.clouds import read_cloud
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

LIDAR = 'samples/LIDAR_TOP/'  # key frames lie here, the sweeps between them in sweeps/
# The sensor's x points right and y forward; KITTI's x points forward and y left.
T_KITTI_SENSOR = se3.from_xyz_rpy(yaw=-np.pi / 2)


@dataclass(frozen=True)
class KeyFrame:
    """One LIDAR_TOP key frame.

    Attributes:
        path: of the points.
        T_world_lidar: pose of the sensor, axes turned to KITTI's, in the map's frame.
    """

    path: Path
    T_world_lidar: Float[np.ndarray, '4 4']


class NuScenesSequence:
    """Implements `gcl_core.data.sequence.Sequence`: the scenes of one log in a row, by time.

    Points are turned by 90 degrees to KITTI's axes (x forward, y left, z up), poses with them.
    The gaps between the scenes of a log stay gaps: neighbouring key frames may lie far apart.
    """

    def __init__(self, log: str, frames: list[KeyFrame]) -> None:
        self.name = f'nuscenes/{log}'
        self._frames = frames

    def __len__(self) -> int:
        return len(self._frames)

    def scan(self, index: int) -> PointCloud:
        """Read one key frame, KITTI's axes.

        Raises:
            GclError: missing or broken.
        """
        path = self._frames[index].path
        if not path.is_file():
            raise GclError(f'no file {path}; download the key frames of LIDAR_TOP into it')
        return read_cloud(path).moved(T_KITTI_SENSOR)

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose of the sensor, KITTI's axes, in the map's frame."""
        return self._frames[index].T_world_lidar


def read_logs(root: Path, version: str | None = None) -> dict[str, NuScenesSequence]:
    """Read the tables once; return the sequence of every log, by the log's name.

    Args:
        root: folder that holds `samples/LIDAR_TOP` and one folder of tables for each version.
        version: such as `v1.0-mini`; may be left out where there is one.

    Raises:
        GclError: a table is missing or malformed; the message says what was expected where.
    """
    tables = root / (version or _only_version(root))
    frames = _read(tables, 'sample_data', lambda r: r if _is_lidar_key_frame(r) else None)
    _check(frames, tables)
    poses = {f['ego_pose_token'] for f in frames.values()}
    ego = _read(tables, 'ego_pose', lambda r: r if r['token'] in poses else None)
    mounts = _read(tables, 'calibrated_sensor')
    samples, scenes, logs = (_read(tables, name) for name in ('sample', 'scene', 'log'))
    found: dict[str, list[KeyFrame]] = {}
    for frame in sorted(frames.values(), key=lambda f: f['timestamp']):
        sample = _row(samples, frame['sample_token'], tables, 'sample')
        scene = _row(scenes, sample['scene_token'], tables, 'scene')
        log = _row(logs, scene['log_token'], tables, 'log')
        T_world_ego = _pose(ego, frame['ego_pose_token'], tables, 'ego_pose')
        mount = _pose(mounts, frame['calibrated_sensor_token'], tables, 'calibrated_sensor')
        T_world_lidar = T_world_ego @ mount @ se3.inverse(T_KITTI_SENSOR)
        found.setdefault(log['logfile'], []).append(
            KeyFrame(root / frame['filename'], T_world_lidar)
        )
    if not found:
        raise GclError(f'{tables}/sample_data.json lists no key frame in {LIDAR}')
    return {log: NuScenesSequence(log, found[log]) for log in sorted(found)}


def versions(root: Path) -> list[str]:
    """Names of the folders of tables."""
    return sorted(p.parent.name for p in root.glob('*/sample_data.json'))


def _only_version(root: Path) -> str:
    found = versions(root)
    if len(found) == 1:
        return found[0]
    if found:
        raise GclError(
            f'{root} holds the versions {", ".join(found)}; name the folder of one, such '
            f'as {root / found[0]}'
        )
    raise GclError(
        f'no {root}/v1.0-*/sample_data.json; nuScenes is laid out as v1.0-trainval/*.json '
        f'beside {LIDAR}*.pcd.bin'
    )


def _is_lidar_key_frame(row: dict[str, Any]) -> bool:
    return bool(row['is_key_frame']) and str(row['filename']).startswith(LIDAR)


def _read(
    tables: Path, name: str, keep: Callable[[dict[str, Any]], Any] = lambda row: row
) -> dict[str, dict[str, Any]]:
    """Read a table by token; rows that `keep` refuses are dropped while parsing.

    Of 2.6 million rows in the full tables, other sensors' among them, 1 in 80 is kept. The text of
    a table is held whole for that moment: 1.2 GB, and about 6 s to parse.
    """
    path = tables / f'{name}.json'
    try:
        rows = read_json(
            path, 'it belongs to the nuScenes metadata: is the download whole?', object_hook=keep
        )
        return {row['token']: row for row in rows if row is not None}
    except GclError:
        raise
    except KeyError as error:
        raise GclError(f'{path}: a row lacks {error}; is it a nuScenes table?') from None
    except (ValueError, TypeError) as error:
        raise GclError(f'{path} is not a nuScenes table: {error}') from None


def _check(frames: dict[str, dict[str, Any]], tables: Path) -> None:
    """Check that key frames have what is read of them."""
    tokens = ('sample_token', 'ego_pose_token', 'calibrated_sensor_token')
    for frame in frames.values():
        whole = isinstance(frame.get('timestamp'), int)
        if not whole or any(not isinstance(frame.get(key), str) for key in tokens):
            raise GclError(
                f'{tables}/sample_data.json: key frame {frame["token"]!r} lacks a timestamp or '
                f'one of {", ".join(tokens)}; the metadata is damaged'
            )


class _Row(dict[str, Any]):
    """A row of a table; what it lacks is named."""

    def __missing__(self, key: str) -> Any:
        raise GclError(f'a row of nuScenes metadata lacks {key!r}; is the download whole?')


def _row(table: dict[str, dict[str, Any]], token: str, tables: Path, name: str) -> _Row:
    if not isinstance(token, str) or not isinstance(table.get(token), dict):
        raise GclError(f'{tables}/{name}.json has no row {token!r}; the metadata is incomplete')
    return _Row(table[token])


def _pose(
    table: dict[str, dict[str, Any]], token: str, tables: Path, name: str
) -> Float[np.ndarray, '4 4']:
    """Pose of a row with `rotation` (w, x, y, z) and `translation`, metres."""
    row = _row(table, token, tables, name)
    try:
        w, x, y, z = row['rotation']
        where = np.array(row['translation'], dtype=float).reshape(3)
        T = se3.from_rotation_translation(se3.from_quaternion(x, y, z, w), where)
    except (TypeError, ValueError, OverflowError) as error:
        raise GclError(f'{tables}/{name}.json, row {token!r} is no pose: {error}') from None
    if not np.isfinite(T).all():
        raise GclError(f'{tables}/{name}.json, row {token!r} is no finite pose')
    return T
