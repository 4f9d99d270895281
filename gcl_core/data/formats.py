"""Any source of scans by its path: the format is seen from the layout, or told."""

from __future__ import annotations

from pathlib import Path

from gcl_core.data.clouds import FORMATS
from gcl_core.data.eth import EthSequence
from gcl_core.data.folder import FolderSequence
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.nuscenes import read_logs, versions
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError

LAYOUTS = {
    'kitti': 'sequences/NN/velodyne/*.bin, calib.txt, and poses/NN.txt or sequences/NN/poses.txt',
    'nuscenes': 'v1.0-*/*.json and samples/LIDAR_TOP/*.pcd.bin',
    'eth': 'Hokuyo_*.ply and gt.log, or folders of those',
    'rosbag2': 'metadata.yaml beside *.mcap or *.db3',
    'folder': f'{", ".join(FORMATS)} files, with or without poses.txt',
}


def open_sequence(
    path: Path, sequence: str | None = None, *, layout: str | None = None
) -> Sequence:
    """Open one drive.

    Args:
        path: root of a data set, one scene of ETH, one sequence folder of KITTI, a bag, or a
            folder of clouds.
        sequence: which one: KITTI's digits (`08`, or `08-suma` for SemanticKITTI's poses),
            nuScenes' log, ETH's scene, a bag's cloud topic (`/points`). May be left out where
            there is only one.
        layout: one of `LAYOUTS`; None looks.

    Raises:
        GclError: no known layout, or not the one that was told; the message says what was
            expected where.
    """
    if not path.exists():
        raise GclError(f'no folder {path}')
    layout = layout or detect(path)
    if layout == 'kitti':
        return _open_kitti(path, sequence)
    if layout == 'nuscenes':
        logs = read_logs(path)
        return logs[_one_of(list(logs), sequence, f'{path}: nuScenes log')]
    if layout == 'eth':
        if (path / 'gt.log').is_file():
            return EthSequence(path)
        scenes = sorted(log.parent.name for log in path.glob('*/gt.log'))
        return EthSequence(path / _one_of(scenes, sequence, f'{path}: ETH scene'))
    if layout == 'rosbag2':
        from gcl_ros.bag_sequence import BagSequence

        return BagSequence(path, topic=sequence if (sequence or '').startswith('/') else None)
    if layout == 'folder':
        return FolderSequence(path)
    raise GclError(f'unknown format {layout!r}; choose one of {", ".join(LAYOUTS)}')


def detect(path: Path) -> str:
    """Name of the layout of a path.

    Raises:
        GclError: none fits.
    """
    if (path / 'sequences').is_dir() or (path / 'velodyne').is_dir():
        return 'kitti'
    if versions(path):
        return 'nuscenes'
    if (path / 'gt.log').is_file() or any(path.glob('*/gt.log')):
        return 'eth'
    if path.suffix in ('.mcap', '.db3') or (path / 'metadata.yaml').is_file():
        return 'rosbag2'
    if any(file.suffix in FORMATS for file in path.glob('*')):
        return 'folder'
    known = '\n'.join(f'  {name}: {layout}' for name, layout in LAYOUTS.items())
    raise GclError(f'{path} has no layout that is known here; expected one of\n{known}')


def _open_kitti(path: Path, sequence: str | None) -> KittiSequence:
    """Open by the root and the digits, or by the folder of one sequence."""
    if (path / 'velodyne').is_dir():
        folder = path.resolve()
        return KittiSequence(folder.parents[1], folder.name)
    found = sorted(folder.name for folder in (path / 'sequences').glob('*') if folder.is_dir())
    if sequence is None:
        sequence = _one_of(found, None, f'{path}: KITTI sequence')
    digits = sequence.removesuffix('-suma')
    return KittiSequence(path, digits, 'auto' if digits == sequence else 'semantickitti')


def _one_of(found: list[str], wanted: str | None, what: str) -> str:
    """The wanted name, or the only one there is."""
    if wanted is None and len(found) == 1:
        return found[0]
    if wanted in found:
        return str(wanted)
    known = ', '.join(found) or 'none'
    if wanted is None:
        raise GclError(f'{what}: name one of {known}')
    raise GclError(f'{what} {wanted!r} is not there; there are {known}')
