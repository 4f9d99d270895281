"""Write sequences in the layout of KITTI odometry, as `KittiSequence` reads them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from gcl_core import se3
from gcl_core.data.clouds import write_cloud
from gcl_core.data.poses import write_poses
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError
from gcl_core.progress import progress

IDENTITY = '1 0 0 0 0 1 0 0 0 0 1 0'


def write_kitti(
    root: Path,
    number: str,
    sequence: Sequence,
    indices: Iterable[int],
    stamps: Iterable[float],
    *,
    T_origin_world: np.ndarray | None = None,
) -> int:
    """Write scans with their poses and times; return how many.

    `Tr` is the identity: the poses written are the LiDAR's own.

    Args:
        root: folder that gets `sequences/NUMBER` and `poses/NUMBER.txt`.
        number: two digits.
        sequence: where the scans come from.
        indices: scans to write.
        stamps: seconds of each of them.
        T_origin_world: frame of the written poses; the first scan's own when None. Give two
            sequences of one world the same, and their poses can be compared.

    Raises:
        GclError: the sequence exists already, or a file cannot be written.
    """
    folder = root / 'sequences' / number
    if folder.exists():
        raise GclError(f'{folder} exists already; remove it or choose another folder')
    indices = list(indices)
    if T_origin_world is None:
        T_origin_world = se3.inverse(sequence.T_world_lidar(indices[0]))
    try:
        (folder / 'velodyne').mkdir(parents=True)
        (root / 'poses').mkdir(exist_ok=True)
        poses = []
        for row, index in enumerate(progress(indices, desc=number, unit='scan')):
            write_cloud(folder / 'velodyne' / f'{row:06d}.bin', sequence.scan(index))
            poses.append(T_origin_world @ sequence.T_world_lidar(index))
        write_poses(root / 'poses' / f'{number}.txt', poses)
        (folder / 'calib.txt').write_text(f'Tr: {IDENTITY}\n')
        times = (f'{stamp:.6e}\n' for stamp in stamps)
        (folder / 'times.txt').write_text(''.join(times))
    except OSError as error:
        raise GclError(f'cannot write {folder}: {error.strerror}') from None
    return len(indices)
