"""Point clouds in files: KITTI .bin, .pcd, .ply, .npy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcl_core.data.cloud_headers import Header, read_header
from gcl_core.errors import GclError
from gcl_core.files import whole_file
from gcl_core.types import PointCloud

FORMATS = ('.bin', '.pcd', '.ply', '.npy')


def read_cloud(path: Path) -> PointCloud:
    """Read a cloud by its suffix; points that are not finite are dropped.

    `.bin` holds float32 x, y, z, intensity (KITTI), `.pcd.bin` also the ring (nuScenes; in its own
    axes); `.npy` an array with at least three columns.

    Raises:
        GclError: missing, broken, empty, or of an unknown format.
    """
    if path.is_dir():
        raise GclError(f'{path} is a folder; name one cloud in it, {", ".join(FORMATS)}')
    if path.suffix not in FORMATS:
        raise GclError(f'{path}: unknown format {path.suffix!r}; use {", ".join(FORMATS)}')
    if not path.is_file():
        raise GclError(f'no file {path}')
    if path.suffix == '.bin':
        array = _read_bin(path)
    elif path.suffix == '.npy':
        array = _read_npy(path)
    else:
        array = _read_with_header(path)
    if len(array) == 0:
        raise GclError(f'{path} holds no points; is it a broken {path.suffix} file?')
    return PointCloud.from_array(array, str(path))


def write_cloud(path: Path, cloud: PointCloud) -> None:
    """Write a cloud in the format of its suffix.

    Raises:
        GclError: unknown format, or the file cannot be written.
    """
    import open3d as o3d

    if path.suffix not in FORMATS:
        raise GclError(f'{path}: unknown format {path.suffix!r}; use {", ".join(FORMATS)}')
    with whole_file(path) as part:
        if path.suffix == '.npy':
            np.save(part, cloud.points, allow_pickle=False)
        elif path.suffix == '.bin':
            rows = np.column_stack([cloud.points, np.zeros(len(cloud), np.float32)])
            rows.astype(np.float32).tofile(part)
        else:
            tensor = o3d.t.geometry.PointCloud(o3d.core.Tensor(cloud.points))
            with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
                written = o3d.t.io.write_point_cloud(str(part), tensor)
            if not written or part.stat().st_size < cloud.points.nbytes:  # .ply never says no
                raise GclError(f'cannot write {path}: does its folder exist, is the disk full?')


def _read_bin(path: Path) -> np.ndarray:
    columns = ['x', 'y', 'z', 'intensity']
    if path.name.endswith('.pcd.bin'):
        columns.append('ring')
    size, row = path.stat().st_size, 4 * len(columns)
    if size % row:
        raise GclError(
            f'{path} has {size} bytes, not a multiple of {row} (float32 {", ".join(columns)}): '
            'it is cut off or of another layout'
        )
    return np.fromfile(path, dtype=np.float32).reshape(-1, len(columns))


def _read_npy(path: Path) -> np.ndarray:
    try:
        # Mapped: numpy then holds the size that the header claims against that of the file.
        array = np.load(path, allow_pickle=False, mmap_mode='r')
    except Exception as error:  # its header is Python, and fails as Python does
        raise GclError(f'{path} is not a .npy file of numbers: {error}') from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in 'fiu':
        raise GclError(f'{path} does not hold an array of numbers')
    return np.array(array)


def _read_with_header(path: Path) -> np.ndarray:
    header, end = read_header(path)
    missing = [axis for axis in 'xyz' if axis not in header.columns]
    if missing:
        raise GclError(f'{path} has no {", ".join(missing)}; it has {", ".join(header.columns)}')
    return _read_text(path, header, end) if header.text else _read_open3d(path)


def _read_text(path: Path, header: Header, end: int) -> np.ndarray:
    """Read the points of a text file, each of which must be there."""
    with path.open('rb') as file:
        file.seek(end)
        lines = [line for line in file if line.strip()]
    lines = lines[header.skip : header.skip + header.rows]
    if len(lines) < header.rows:
        raise GclError(f'{path} claims {header.rows} points, but has {len(lines)}; it is cut off')
    columns = [header.columns.index(axis) for axis in 'xyz']
    try:
        return np.loadtxt(lines, np.float32, usecols=columns, ndmin=2, encoding='latin-1')
    except ValueError as error:
        raise GclError(f'{path}: a line holds no point: {error}; export it anew') from None


def _read_open3d(path: Path) -> np.ndarray:
    import open3d as o3d

    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        try:
            cloud = o3d.t.io.read_point_cloud(str(path))
        except (RuntimeError, ValueError, MemoryError) as error:
            raise GclError(f'{path} is not a readable {path.suffix} file: {error}') from None
    if 'positions' not in cloud.point:
        return np.empty((0, 3), dtype=np.float32)
    positions: np.ndarray = cloud.point['positions'].numpy()
    return positions
