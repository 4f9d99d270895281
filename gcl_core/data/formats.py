"""Any source of scans by its path: the format is seen from the layout, or told."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as List
from pathlib import Path

from gcl_core.data.bin_layout import BinLayout
from gcl_core.data.clouds import FORMATS, CloudReader
from gcl_core.data.eth import EthSequence
from gcl_core.data.folder import FolderSequence
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.nuscenes import NuScenesSequence, read_logs, versions
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError

Names = List[str] | List[None]  # None: the only one there is

BAGS = ('.mcap', '.db3')
LAYOUTS = {
    'kitti': 'sequences/NN/velodyne/*.bin, calib.txt, and poses/NN.txt or sequences/NN/poses.txt',
    'nuscenes': 'v1.0-*/*.json and samples/LIDAR_TOP/*.pcd.bin',
    'eth': 'Hokuyo_*.ply and gt.log, or folders of those',
    'rosbag2': 'metadata.yaml beside *.mcap or *.db3, or such a file',
    'folder': f'{", ".join(FORMATS)} files, with or without poses.txt',
}


def open_sequence(
    path: Path,
    sequence: str | None = None,
    *,
    layout: str | None = None,
    columns: BinLayout | None = None,
) -> Sequence:
    """Open one drive.

    Args:
        path: root of a data set, one scene of ETH, one sequence folder of KITTI, one version's
            tables of nuScenes, a bag, or a folder of clouds.
        sequence: which one: KITTI's digits (`08`, or `08-suma` for SemanticKITTI's poses),
            nuScenes' log, ETH's scene, a bag's cloud topic (`/points`). May be left out where
            there is only one.
        layout: one of `LAYOUTS`; None looks.
        columns: of `.bin` files; None sees them from the numbers.

    Raises:
        GclError: no known layout, or not the one that was told; the message says what was
            expected where.
    """
    names = None if sequence is None else [sequence]
    (found,) = open_sequences(path, names, layout=layout, columns=columns).values()
    return found


def open_sequences(
    path: Path,
    names: List[str] | None = None,
    *,
    layout: str | None = None,
    columns: BinLayout | None = None,
) -> dict[str, Sequence]:
    """Open drives of one data set by the short names that a pair list gives them.

    Without names there must be one; it is called by the end of its own name then, such as
    `my_drive` for `folder/my_drive`. Arguments and errors: see `open_sequence`.
    """
    if not path.exists():
        raise GclError(f'no folder {path}')
    asked: Names = names or [None]
    opened = OPENERS[_known(layout or detect(path))](path, asked)
    for sequence in opened if columns else ():
        if not isinstance(sequence, KittiSequence | FolderSequence):
            raise GclError(f'{path} holds no .bin files of its own; leave --columns {columns} out')
        sequence.clouds = CloudReader(columns)
    return {
        name or sequence.name.split('/', 1)[1]: sequence
        for name, sequence in zip(asked, opened, strict=True)
    }


def sequence_names(path: Path, *, layout: str | None = None) -> list[str]:
    """Names of all drives of a data set.

    Raises:
        GclError: no known layout.
    """
    kind = _known(layout or detect(path))
    if kind == 'kitti' and not (path / 'velodyne').is_dir():
        return _kitti_names(path)
    if kind == 'nuscenes':
        return list(_logs(path))
    if kind == 'eth' and not (path / 'gt.log').is_file():
        return _eth_names(path)
    return list(open_sequences(path, layout=kind))


def _kitti_names(root: Path) -> list[str]:
    return sorted(folder.name for folder in (root / 'sequences').glob('*') if folder.is_dir())


def _eth_names(root: Path) -> list[str]:
    return sorted(log.parent.name for log in root.glob('*/gt.log'))


def _known(layout: str) -> str:
    if layout not in LAYOUTS:
        raise GclError(f'unknown format {layout!r}; choose one of {", ".join(LAYOUTS)}')
    return layout


def detect(path: Path) -> str:
    """Name of the layout of a path.

    Raises:
        GclError: none fits.
    """
    if (path / 'sequences').is_dir() or (path / 'velodyne').is_dir():
        return 'kitti'
    if versions(path) or (path / 'sample_data.json').is_file():
        return 'nuscenes'
    if (path / 'gt.log').is_file() or _eth_names(path):
        return 'eth'
    if path.suffix in (*BAGS, '.bag') or (path / 'metadata.yaml').is_file():
        return 'rosbag2'  # of ROS 1, too: to be told how to make one of ROS 2
    if any(file.suffix.lower() in FORMATS for file in path.glob('*')):
        return 'folder'
    if any(file.suffix in BAGS for file in path.glob('*')):
        return 'rosbag2'
    known = '\n'.join(f'  {name}: {layout}' for name, layout in LAYOUTS.items())
    raise GclError(f'{path} has no layout that is known here; expected one of\n{known}')


def _open_kitti(path: Path, names: Names) -> list[Sequence]:
    """Open by the root and the digits, or by the folder of one sequence."""
    if (path / 'velodyne').is_dir():
        folder = path.resolve()
        own = [folder.name, f'{folder.name}-suma']
        wanted = [name if name in own else _only(path, folder.name, name) for name in names]
        return _open_kitti(folder.parents[1], wanted)
    found = _kitti_names(path)
    opened: list[Sequence] = []
    for name in names:
        known = name or _one_of(found, None, f'{path}: KITTI sequence')
        digits = known.removesuffix('-suma')
        opened.append(KittiSequence(path, digits, 'auto' if digits == known else 'semantickitti'))
    return opened


def _logs(path: Path) -> dict[str, NuScenesSequence]:
    """Every log, by the root, or by the folder of one version's tables."""
    if (path / 'sample_data.json').is_file():
        return read_logs(path.resolve().parent, path.resolve().name)
    return read_logs(path)


def _open_nuscenes(path: Path, names: Names) -> list[Sequence]:
    logs = _logs(path)
    return [logs[_one_of(list(logs), name, f'{path}: nuScenes log')] for name in names]


def _open_eth(path: Path, names: Names) -> list[Sequence]:
    """Open by the root and the scene, or by the folder of one scene."""
    scenes = _eth_names(path)
    if (path / 'gt.log').is_file() or not scenes:
        return [EthSequence(path) for name in names if _only(path, path.resolve().name, name)]
    return [EthSequence(path / _one_of(scenes, name, f'{path}: ETH scene')) for name in names]


def _open_rosbag2(path: Path, names: Names) -> list[Sequence]:
    """Open a bag by its own name, or by a topic of it."""
    from gcl_ros.bag_reader import bag_at
    from gcl_ros.bag_sequence import BagSequence

    own = bag_at(path).resolve().name
    topics = [n if n and n.startswith('/') else _only(path, own, n) and None for n in names]
    return [BagSequence(path, topic=topic) for topic in topics]


def _open_folder(path: Path, names: Names) -> list[Sequence]:
    return [FolderSequence(path) for name in names if _only(path, path.resolve().name, name)]


def _only(path: Path, own: str, wanted: str | None) -> str:
    """The name of what is there, which a list made for another drive does not ask for."""
    return _one_of([own], wanted, f'{path}: sequence')


OPENERS: dict[str, Callable[[Path, Names], list[Sequence]]] = {
    'kitti': _open_kitti,
    'nuscenes': _open_nuscenes,
    'eth': _open_eth,
    'rosbag2': _open_rosbag2,
    'folder': _open_folder,
}


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
