"""ETH: outdoor scenes of one planar laser on a tilting unit, as registration benchmarks use them.

Layout, as 3DSmoothNet published it and SpinNet and others read it, one folder a scene
(`gazebo_summer`, `gazebo_winter`, `wood_autmn` (sic), `wood_summer`):

    wood_autmn/Hokuyo_0.ply  Hokuyo_1.ply  ...
    wood_autmn/gt.log

`gt.log` holds, for every pair that overlaps, a line `i j count` and four lines: a 4x4 matrix that
maps points of cloud j into the frame of cloud i. Made from the clouds and poses of "Challenging
data sets for point cloud registration algorithms" (Pomerleau et al., 2012).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.clouds import read_cloud
from gcl_core.data.poses import is_rigid
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

Links = dict[tuple[int, int], Float[np.ndarray, '4 4']]


class EthSequence:
    """Implements `gcl_core.data.sequence.Sequence`; scan k is `Hokuyo_k.ply`.

    The world is the frame of cloud 0: poses are chained over the fewest links of `gt.log`.
    `links` holds the published transform of every pair, for scores on exactly those.

    Args:
        folder: one scene.

    Raises:
        GclError: something is missing or malformed; the message says what was expected where.
    """

    def __init__(self, folder: Path) -> None:
        self.name = f'eth/{folder.name}'
        self._folder = folder
        numbers = sorted(
            int(match[1])
            for path in folder.glob('Hokuyo_*.ply')
            if (match := re.fullmatch(r'Hokuyo_(\d+)\.ply', path.name))
        )
        if not numbers:
            raise GclError(f'no Hokuyo_0.ply, Hokuyo_1.ply, … in {folder}; ETH keeps a scene so')
        if numbers != list(range(len(numbers))):
            missing = min(set(range(numbers[-1])) - set(numbers))
            raise GclError(f'no file {folder}/Hokuyo_{missing}.ply; the download is incomplete')
        self._count = len(numbers)
        self.links = read_links(folder / 'gt.log', self._count)
        self._poses = _chain(self.links)

    def __len__(self) -> int:
        return self._count

    def scan(self, index: int) -> PointCloud:
        """Read one cloud."""
        return read_cloud(self._folder / f'Hokuyo_{index}.ply')

    def T_world_lidar(self, index: int) -> Float[np.ndarray, '4 4']:
        """Pose in the frame of cloud 0.

        Raises:
            GclError: `gt.log` does not link the cloud to cloud 0.
        """
        if index not in self._poses:
            raise GclError(f'{self._folder}/gt.log does not link cloud {index} to cloud 0')
        return self._poses[index]


def read_links(path: Path, count: int) -> Links:
    """Read `gt.log`: `T_i_j` by (i, j).

    Raises:
        GclError: missing or malformed, or it names a cloud that is not among the first `count`.
    """
    try:
        text = path.read_text(errors='replace')
    except OSError:
        raise GclError(f'no file {path}; expected `i j count` and a 4x4 matrix a pair') from None
    lines = [line.split() for line in text.splitlines() if line.strip()]
    links: Links = {}
    for start in range(0, len(lines), 5):
        try:
            i, j = (int(word) for word in lines[start][:2])
            T = np.array(lines[start + 1 : start + 5], dtype=float)
        except ValueError as error:
            raise GclError(f'{path}, entry {start // 5}: {error}') from None
        if T.shape != (4, 4):
            raise GclError(f'{path}, entry {start // 5}: expected a 4x4 matrix, got {T.shape}')
        if not (0 <= i < count and 0 <= j < count):
            raise GclError(f'{path} links {i} and {j}, but there are {count} clouds')
        if not is_rigid(T):
            raise GclError(f'{path}, entry {start // 5}: the matrix is no rigid motion')
        links[i, j] = T
    return links


def _chain(links: Links) -> dict[int, Float[np.ndarray, '4 4']]:
    """Poses in the frame of cloud 0, breadth first."""
    edges: dict[int, list[tuple[int, Float[np.ndarray, '4 4']]]] = {}
    for (i, j), T_i_j in links.items():
        edges.setdefault(i, []).append((j, T_i_j))
        edges.setdefault(j, []).append((i, se3.inverse(T_i_j)))
    poses = {0: np.eye(4)}
    waiting = [0]
    for known in waiting:
        for other, T_known_other in edges.get(known, []):
            if other not in poses:
                poses[other] = poses[known] @ T_known_other
                waiting.append(other)
    return poses
