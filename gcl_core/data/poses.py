"""Tables of numbers and poses in text files, as KITTI writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core.errors import GclError


def read_table(path: Path, columns: int) -> Float[np.ndarray, 'n c']:
    """Read rows of `columns` numbers.

    Raises:
        GclError: missing, not numbers, of another width, or not finite.
    """
    try:
        table = np.loadtxt(path, ndmin=2)
    except OSError:
        raise GclError(f'no file {path}; expected {columns} numbers a line') from None
    except ValueError as error:
        raise GclError(f'{path}: {error}') from None
    if table.shape[1] != columns:
        raise GclError(f'{path}: expected {columns} numbers a line, got {table.shape[1]}')
    if not np.isfinite(table).all():
        raise GclError(f'{path} holds a number that is not finite')
    return table


def read_poses(path: Path) -> Float[np.ndarray, 'n 4 4']:
    """Read one 3x4 pose a line, row by row: KITTI's 12 numbers.

    Raises:
        GclError: see `read_table`; or a rotation is none (off by more than 1 %).
    """
    table = read_table(path, 12)
    poses = np.zeros((len(table), 4, 4))
    poses[:, :3] = table.reshape(-1, 3, 4)
    poses[:, 3, 3] = 1.0
    rotation = poses[:, :3, :3]
    off = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max((1, 2))
    bad = np.flatnonzero((off > 0.01) | (np.linalg.det(rotation) < 0))
    if len(bad):
        raise GclError(
            f'{path}, line {bad[0] + 1}: the first three columns are no rotation; '
            'expected the 3x4 matrix [R | t] row by row'
        )
    return poses
