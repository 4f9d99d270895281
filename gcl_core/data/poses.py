"""Poses, and other numbers, in text files as KITTI writes them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core.errors import GclError


def read_poses(path: Path) -> Float[np.ndarray, 'n 4 4']:
    """Read one 3x4 pose a line, row by row: KITTI's 12 numbers.

    Raises:
        GclError: missing, not numbers, of another width, not finite, or a rotation is none (off by
            more than 1 %).
    """
    table = read_table(path, 12)
    poses = np.zeros((len(table), 4, 4))
    poses[:, :3] = table.reshape(-1, 3, 4)
    poses[:, 3, 3] = 1.0
    bad = np.flatnonzero([not is_rigid(pose) for pose in poses])
    if len(bad):
        raise GclError(
            f'{path}, line {bad[0] + 1}: the first three columns are no rotation; '
            'expected the 3x4 matrix [R | t] row by row'
        )
    return poses


def write_poses(path: Path, poses: Iterable[Float[np.ndarray, '4 4']]) -> None:
    """Write what `read_poses` reads."""
    lines = (' '.join(f'{value:.9e}' for value in T[:3].ravel()) for T in poses)
    path.write_text(''.join(f'{line}\n' for line in lines))


def read_table(path: Path, width: int) -> Float[np.ndarray, 'n width']:
    """Read a text file of numbers, so many a line.

    Raises:
        GclError: missing, empty, not numbers, of another width, not finite.
    """
    expected = f'expected {width} number{"s" if width > 1 else ""} a line'
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # of an empty file, which is refused below
            table = np.loadtxt(path, ndmin=2)
    except OSError:
        raise GclError(f'no file {path}; {expected}') from None
    except ValueError as error:
        raise GclError(f'{path}: {error}') from None
    if not table.size:
        raise GclError(f'{path} is empty; {expected}')
    if table.shape[1] != width:
        raise GclError(f'{path}: {expected}, got {table.shape[1]}')
    if not np.isfinite(table).all():
        raise GclError(f'{path} holds a number that is not finite')
    return table


def is_rigid(T: Float[np.ndarray, '4 4']) -> bool:
    """Whether a matrix is finite and its rotation is one, within 1 %."""
    rotation = T[:3, :3]
    if not np.isfinite(T).all() or np.abs(rotation).max() > 2.0:
        return False
    off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    return bool(off <= 0.01 and np.linalg.det(rotation) > 0)
