"""Point clouds in files: KITTI .bin, .pcd, .ply, .npy, and .gcl, a compact scan."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.data.bin_layout import KITTI, NUSCENES, REMEDY, BinLayout, recognised, rows
from gcl_core.data.cloud_headers import PADDING, Header, read_header
from gcl_core.data.lzf import decompressed
from gcl_core.errors import GclError
from gcl_core.files import whole_file
from gcl_core.types import PointCloud

FORMATS = ('.bin', '.pcd', '.ply', '.npy', '.gcl')
log = logging.getLogger(__name__)


def read_cloud(path: Path, layout: BinLayout | None = None) -> PointCloud:
    """Read a cloud by its suffix; points that are not finite are dropped.

    `.npy` holds an array with a row for each point. A `.pcd` is read as stored, whatever its
    VIEWPOINT. Of a `.gcl` a point a voxel comes back, see `gcl_core.compact`.

    Args:
        path: the file.
        layout: of a `.bin`; None sees it, as `bin_layout` does.

    Raises:
        GclError: missing, broken, empty, or of an unknown format.
    """
    suffix = known_format(path)
    if suffix == '.bin':
        array = _read_bin(path, layout)
    elif layout:
        raise GclError(f'{path}: only a .bin takes columns; the header of {suffix} names its own')
    elif suffix == '.gcl':
        return replace(decode(path.read_bytes(), str(path)), name=str(path))
    else:
        array = _read_npy(path) if suffix == '.npy' else _read_with_header(path)
    if len(array) == 0:
        raise GclError(f'{path} holds no points; is it a broken {suffix} file?')
    return PointCloud.from_array(array, str(path))


def known_format(path: Path) -> str:
    """Suffix of a file of a known format, in lower case.

    Raises:
        GclError: it is a folder, of another format, or not there.
    """
    if path.is_dir():
        raise GclError(f'{path} is a folder; name one cloud in it, {", ".join(FORMATS)}')
    suffix = writable_format(path)
    if not path.is_file():
        raise GclError(f'no file {path}')
    return suffix


def writable_format(path: Path) -> str:
    """Suffix of a file to write, in lower case.

    Raises:
        GclError: it is of no known format.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise GclError(f'{path}: unknown format {path.suffix!r}; use {", ".join(FORMATS)}')
    return suffix


def bin_layout(path: Path) -> BinLayout:
    """Columns of a `.bin`, which has no header; one line of the log where they are not KITTI's.

    A `.pcd.bin` is nuScenes' (float32 x, y, z, intensity, ring; in its own axes); else the numbers
    tell.

    Raises:
        GclError: they do not.
    """
    if path.name.lower().endswith('.pcd.bin'):
        return NUSCENES
    layout = recognised(np.fromfile(path, np.uint8), str(path))
    if layout != KITTI:
        log.warning('%s is read as %s, as its numbers show; if wrong, %s', path, layout, REMEDY)
    return layout


class CloudReader:
    """Reads the clouds of one drive; its `.bin` files all have the columns of the first.

    Attributes:
        layout: of `.bin` files; None until it is seen.
    """

    def __init__(self, layout: BinLayout | None = None) -> None:
        self.layout = layout

    def __call__(self, path: Path) -> PointCloud:
        """Read one; errors as `read_cloud`."""
        if self.layout is None and path.suffix.lower() == '.bin' and path.is_file():
            self.layout = bin_layout(path)
        return read_cloud(path, self.layout)


def write_cloud(path: Path, cloud: PointCloud, compact: CompactConfig | None = None) -> None:
    """Write a cloud in the format of its suffix, .pcd and .ply in binary.

    Args:
        path: the file.
        cloud: its points.
        compact: how much of them a `.gcl` keeps.

    Raises:
        GclError: unknown format, nothing that a `.gcl` keeps, or the file cannot be written.
    """
    suffix, points = writable_format(path), np.ascontiguousarray(cloud.points, '<f4')
    data = encode(cloud, compact) if suffix == '.gcl' else b''
    with whole_file(path) as part, part.open('wb') as file:
        if suffix == '.gcl':
            file.write(data)
        elif suffix == '.npy':
            np.save(file, cloud.points, allow_pickle=False)
        elif suffix == '.bin':
            file.write(np.column_stack([points, np.zeros(len(cloud), '<f4')]).tobytes())
        else:
            head = PCD if suffix == '.pcd' else PLY
            file.write(head.format(points=len(cloud)).encode() + points.tobytes())


PCD = (
    'VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {points}\nHEIGHT 1\n'
    'VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA binary\n'
)
PLY = (
    'ply\nformat binary_little_endian 1.0\nelement vertex {points}\n'
    'property float x\nproperty float y\nproperty float z\nend_header\n'
)


def _read_bin(path: Path, layout: BinLayout | None) -> Float[np.ndarray, 'n c']:
    data = np.fromfile(path, np.uint8)
    if len(data) == 0:
        return np.empty((0, 3), np.float32)
    return rows(data, layout or bin_layout(path), str(path))


def _read_npy(path: Path) -> np.ndarray:
    try:
        # Mapped: numpy then holds the size that the header claims against that of the file.
        array = np.load(path, allow_pickle=False, mmap_mode='r')
    except Exception as error:  # its header is Python, and fails as Python does
        raise GclError(f'{path} is not a .npy file of numbers: {error}') from None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in 'fiu':
        raise GclError(f'{path} does not hold an array of numbers')
    return np.array(array)


def _read_with_header(path: Path) -> Float[np.ndarray, 'n 3']:
    header, end = read_header(path)
    if header.rows == 0:
        return np.empty((0, 3), np.float32)
    if header.data == 'ascii':
        return _read_text(path, header, end)
    if header.data == 'binary_compressed':
        return _read_compressed(path, header, end)
    table = np.fromfile(path, header.xyz, count=header.rows, offset=end + header.skip)
    return np.stack([table[axis] for axis in 'xyz'], axis=1)


def _read_text(path: Path, header: Header, end: int) -> Float[np.ndarray, 'n 3']:
    """Read the points of a text file, each of which must be there."""
    with path.open('rb') as file:
        file.seek(end)
        lines = [line for line in file if line.strip()]
    lines = lines[header.skip : header.skip + header.rows]
    if len(lines) < header.rows:
        raise GclError(f'{path} claims {header.rows} points, but has {len(lines)}; it is cut off')
    columns = [header.column(axis) for axis in 'xyz']
    try:
        return np.loadtxt(lines, np.float32, usecols=columns, ndmin=2, encoding='latin-1')
    except ValueError as error:
        raise GclError(f'{path}: a line holds no point: {error}; export it anew') from None


def _read_compressed(path: Path, header: Header, end: int) -> Float[np.ndarray, 'n 3']:
    """Read LZF: two sizes of 4 bytes, then each field of all points in turn."""
    with path.open('rb') as file:
        file.seek(end)
        packed, whole = (int(size) for size in np.frombuffer(file.read(8).ljust(8, b'\0'), '<u4'))
        data = file.read()[:packed]  # not read(packed): it takes what is claimed
    fields = header.fields
    if whole != header.rows * header.least:  # PCL names the padding, but leaves it out
        fields = tuple(field for field in fields if field.name != PADDING)
    sizes = [header.rows * field.size for field in fields]
    if whole != sum(sizes) or len(data) < packed:
        raise GclError(
            f'{path}: {whole} bytes in {packed} do not hold its {header.rows} points; it is cut '
            'off, or its header is wrong'
        )
    names = [field.name for field in fields]
    places = [names.index(axis) for axis in 'xyz']
    ends = np.cumsum(sizes)
    try:
        values = decompressed(data, int(ends[max(places)]))
    except GclError as error:
        raise GclError(f'{path}: {error}') from None
    columns = [
        np.frombuffer(values, fields[at].kind, header.rows, int(ends[at]) - sizes[at])
        for at in places
    ]
    return np.stack(columns, axis=1)
