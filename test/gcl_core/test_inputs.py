"""What users bring: files, each with what comes of it; the next report is a row."""

import json
import re
import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gcl_core.cli.main import main
from gcl_core.compact.scan import CHECKSUM, HEADER, SIZE, CompactConfig, encode
from gcl_core.data.bin_layout import BinLayout
from gcl_core.data.clouds import read_cloud
from gcl_core.data.formats import open_sequence
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

N = 5000
RNG = np.random.default_rng(5)
XYZ = (RNG.normal(0, 1, (N, 3)) * [25, 18, 1.5]).astype(np.float32)
INTENSITY = RNG.integers(0, 256, (N, 1)).astype(np.float32)
RING = np.repeat(np.arange(20), N // 20)[:, None].astype(np.float32)
TIME = np.linspace(0, 0.1, N, dtype=np.float32)[:, None]
NORMALS = RNG.normal(0, 0.5, (N, 3)).astype(np.float32)
ZERO = np.zeros((N, 1), np.float32)


@dataclass(frozen=True)
class Case:
    """A file and what comes of it.

    Attributes:
        name: of the file.
        data: its bytes, or what writes it.
        words: of the refusal; empty where the points of `XYZ` are read.
        points: what is read.
    """

    name: str
    data: Any
    words: str = ''
    points: Any = None


def pcd(fields, data, *, kind='binary', rows=N, order='FIELDS', **replaced):
    """A .pcd from (name, type, size, count) and the bytes of its points."""
    lines = {
        'VERSION': '0.7',
        order: ' '.join(f[0] for f in fields),
        'SIZE': ' '.join(str(f[2]) for f in fields),
        'TYPE': ' '.join(f[1] for f in fields),
        'COUNT': ' '.join(str(f[3]) for f in fields),
        'WIDTH': rows,
        'HEIGHT': 1,
        'VIEWPOINT': '0 0 0 1 0 0 0',
        'POINTS': rows,
        'DATA': kind,
    }
    lines = lines | replaced
    head = '# .PCD\n' + ''.join(f'{k} {v}\n' for k, v in lines.items() if v is not None)
    return head.encode() + data


F = ('F', 4, 1)
PCL = [('x', *F), ('y', *F), ('z', *F), ('_', 'U', 1, 4), ('intensity', *F), ('_', 'U', 1, 12)]
PADDED = np.zeros(N, np.dtype([('xyz', '<f4', 3), ('a', 'V4'), ('i', '<f4'), ('b', 'V12')]))
PADDED['xyz'] = XYZ
PADDED['a'], PADDED['b'] = np.void(b'\xff' * 4), np.void(b'\xff' * 12)
PLAIN = [('x', *F), ('y', *F), ('z', *F)]


def literal(data):
    """LZF of bytes, none of them repeated."""
    parts = [data[i : i + 32] for i in range(0, len(data), 32)]
    return b''.join(bytes([len(part) - 1]) + part for part in parts)


def packed(data, packed_size=None, whole=None):
    """The compressed part of a .pcd."""
    body = literal(data)
    sizes = (packed_size or len(body), len(data) if whole is None else whole)
    return struct.pack('<II', *sizes) + body


COLUMNS = XYZ.T.tobytes()  # each field of all points in turn
TYPED = np.zeros(
    N, np.dtype([('label', '<u2'), ('z', '<f4'), ('y', '<f8'), ('h', '<f4', 33), ('x', '<f8')])
)
for at, axis in enumerate('xyz'):
    TYPED[axis] = XYZ[:, at]
TYPES = [('label', 'U', 2, 1), ('z', *F), ('y', 'F', 8, 1), ('fpfh', 'F', 4, 33)]
TYPES += [('x', 'F', 8, 1)]
WHOLE = np.round(XYZ).astype('<i2')
HOLES = XYZ.copy()
HOLES[::3] = np.nan
TEXT = '\n'.join(f'{x:.9g} {y:.9g} 7 {z:.9g}' for x, y, z in XYZ).encode()
TEXT_FIELDS = [('x', *F), ('y', *F), ('ring', 'U', 2, 1), ('z', *F)]
FPFH = '\n'.join(f'1 2 3 {x:.9g} {y:.9g} {z:.9g}' for x, y, z in XYZ).encode()

PCDS = [
    Case('pcl_padding.pcd', pcd(PCL, PADDED.tobytes())),
    Case('PCL.PCD', pcd(PCL, PADDED.tobytes())),
    Case(
        'pcl_padding_compressed.pcd',
        pcd(
            PCL,
            packed(COLUMNS + PADDED['a'].tobytes() + COLUMNS[: 4 * N] + PADDED['b'].tobytes()),
            kind='binary_compressed',
        ),
    ),
    Case(  # PCL's writer names the padding and leaves it out
        'padding_left_out.pcd',
        pcd(PCL, packed(COLUMNS + COLUMNS[: 4 * N]), kind='binary_compressed'),
    ),
    Case('types_and_counts.pcd', pcd(TYPES, TYPED.tobytes())),
    Case('old.pcd', pcd(PLAIN, XYZ.tobytes(), order='COLUMNS', VERSION='.5', VIEWPOINT=None)),
    Case('crlf.pcd', pcd(PLAIN, b'').replace(b'\n', b'\r\n') + XYZ.tobytes()),
    Case('organised.pcd', pcd(PLAIN, XYZ.tobytes(), WIDTH=N // 20, HEIGHT=20)),
    Case('viewpoint.pcd', pcd(PLAIN, XYZ.tobytes(), VIEWPOINT='5 5 5 0 0 0 1')),
    Case('no_returns.pcd', pcd(PLAIN, HOLES.tobytes()), points=HOLES[np.isfinite(HOLES[:, 0])]),
    Case('integers.pcd', pcd([(a, 'I', 2, 1) for a in 'xyz'], WHOLE.tobytes()), points=WHOLE),
    Case('text.pcd', pcd(TEXT_FIELDS, TEXT, kind='ascii')),
    Case('histogram.pcd', pcd([('fpfh', 'F', 4, 3), *PLAIN], FPFH, kind='ascii')),
    Case('two_x.pcd', pcd([('x', *F), *PLAIN], bytes(16 * N)), 'x is not one number of a known'),
    Case('x_of_3.pcd', pcd([('x', 'F', 4, 3), *PLAIN[1:]], bytes(20 * N)), 'x is not one number'),
    Case('half.pcd', pcd([(a, 'F', 2, 1) for a in 'xyz'], bytes(6 * N)), 'x is not one number'),
    Case('flat.pcd', pcd(PLAIN[:2], bytes(8 * N)), 'has no z; it has x, y'),
    Case('no_type.pcd', pcd(PLAIN, XYZ.tobytes(), TYPE=None), 'its header lacks TYPE'),
    Case('lzma.pcd', pcd(PLAIN, XYZ.tobytes(), kind='lzma'), 'DATA lzma is not ascii, binary'),
    Case('cut.pcd', pcd(PLAIN, XYZ.tobytes()[:-1]), 'claims 5000 points .* it is cut off'),
    Case('huge.pcd', pcd(PLAIN, bytes(99), rows=10**12), 'claims 1000000000000 points'),
    Case(
        'huge_point.pcd',
        pcd([*PLAIN, ('a', 'U', 65536, 65536)], bytes(9), rows=0),
        'holds no points',
    ),
    Case(
        'huge_compressed.pcd',
        pcd(PLAIN, struct.pack('<II', 2**32 - 1, 12 * N) + bytes(800), kind='binary_compressed'),
        'do not hold its 5000 points',
    ),
    Case(
        'other_size.pcd',
        pcd(PLAIN, packed(COLUMNS, whole=12 * N + 4), kind='binary_compressed'),
        'do not hold its 5000 points',
    ),
    Case(
        'ends_early.pcd',
        pcd(PLAIN, packed(COLUMNS[:-99], whole=12 * N), kind='binary_compressed'),
        'compressed data end after 59901 of 60000 bytes',
    ),
    Case(
        'refers_back.pcd',
        pcd(PLAIN, struct.pack('<II', 800, 12 * N) + b'\xff' * 800, kind='binary_compressed'),
        'refer to bytes before the first',
    ),
]


def ply(data, *, form='binary_little_endian', before='', after='', properties=None, rows=N):
    """A .ply of vertices, and of what is told around them."""
    own = properties or 'property float x\nproperty float y\nproperty float z\n'
    head = f'ply\nformat {form} 1.0\ncomment made up\n{before}element vertex {rows}\n{own}{after}'
    return f'{head}end_header\n'.encode() + data


FACES = 'element face 1\nproperty list uchar int vertex_indices\n'
CAMERA = 'element camera 2\nproperty double fx\nproperty uint8 id\n'
RICH = 'property uchar red\nproperty double x\nproperty double y\nproperty short a\n'
RICH += 'property double z\nproperty float nx\n'
RICH_TYPE = np.dtype(
    [('red', 'u1'), ('x', '>f8'), ('y', '>f8'), ('a', '>i2'), ('z', '>f8'), ('nx', '>f4')]
)
RICH_ROWS = np.zeros(N, RICH_TYPE)
for at, axis in enumerate('xyz'):
    RICH_ROWS[axis] = XYZ[:, at]
LINES = '\n'.join(f'{x:.9g} {y:.9g} {z:.9g}' for x, y, z in XYZ).encode()

PLYS = [
    Case('little.ply', ply(XYZ.astype('<f4').tobytes())),
    Case('big.PLY', ply(XYZ.astype('>f4').tobytes(), form='binary_big_endian')),
    Case('rich.ply', ply(RICH_ROWS.tobytes(), form='binary_big_endian', properties=RICH)),
    Case('faces.ply', ply(XYZ.tobytes() + b'\3' + bytes(12), after=FACES)),
    Case('camera.ply', ply(bytes(18) + XYZ.tobytes(), before=CAMERA)),
    Case('text.ply', ply(b'1 2\n3 4\n' + LINES, form='ascii', before=CAMERA)),
    Case('faces_first.ply', ply(bytes(99), before=FACES), 'lists in or before its vertices'),
    Case(
        'half.ply',
        ply(XYZ.tobytes(), properties='property half x\n'),
        'a property is of the unknown type half',
    ),
    Case('twice.ply', ply(XYZ.tobytes(), after='element vertex 1\n'), 'vertex stands twice'),
    Case('other.ply', ply(XYZ.tobytes(), form='binary'), "format 'binary' is not ascii, binary_"),
    Case('huge.ply', ply(bytes(99), rows=10**12), 'claims 1000000000000 points'),
    Case('cut.ply', ply(XYZ.tobytes()[:-1]), 'it is cut off'),
    Case('points.ply', ply(XYZ.tobytes()).replace(b'vertex', b'points'), 'header lacks vertex'),
]


def rows(*columns, kind=np.float32):
    """A .bin of these columns."""
    return np.hstack(columns).astype(kind).tobytes()


BINS = [
    Case('kitti.bin', rows(XYZ, INTENSITY / 255)),
    Case('KITTI.BIN', rows(XYZ, INTENSITY / 255)),
    Case('no_intensity.bin', rows(XYZ, ZERO)),
    Case('points.bin', rows(XYZ)),
    Case('ring.bin', rows(XYZ, INTENSITY, RING)),
    Case('nuscenes.pcd.bin', rows(XYZ, INTENSITY, RING)),
    Case('ring_and_time.bin', rows(XYZ, INTENSITY, RING, TIME)),
    Case('unix_time.bin', rows(XYZ, INTENSITY, TIME + np.float64(1.7e9), kind=np.float64)),
    Case('normals.bin', rows(XYZ, INTENSITY, NORMALS)),
    Case('pcl.bin', rows(XYZ, ZERO + 1, INTENSITY, ZERO, ZERO, ZERO)),
    Case('doubles.bin', rows(XYZ * 1.0000001, INTENSITY, kind=np.float64)),
    Case('widened.bin', rows(XYZ, INTENSITY, kind=np.float64)),
    Case('millimetres.bin', rows(np.round(XYZ * 64) / 64, kind=np.float64)),
    Case('cut.bin', rows(XYZ, INTENSITY)[:-4], r'multiple of 16 \(4 columns of float32\)'),
    Case('noise.bin', RNG.bytes(16 * N), 'holds no metres'),
    Case('no_returns.bin', rows(XYZ * np.nan, ZERO), 'does not show how many columns'),
    Case('all_nan.bin', rows(XYZ * np.nan), 'holds no metres'),
    Case('one_number.bin', rows(XYZ[:, [0]]), r'how many columns.*say it by --columns 5'),
    Case('empty.bin', b'', 'holds no points'),
]
BINS[12] = Case('centimetres.bin', BINS[12].data, points=np.round(XYZ * 64) / 64)


def array(value):
    """A .npy."""
    return lambda path: np.save(path, value, allow_pickle=False)


NPYS = [
    Case('rows.npy', array(np.hstack([XYZ, INTENSITY]))),
    Case('doubles.NPY', lambda path: np.save(path.open('wb'), XYZ.astype(float))),
    Case('transposed.npy', array(XYZ.T), r'got shape \(3, 5000\); its columns.*give array\.T'),
    Case('wide.npy', array(np.zeros((99, 500))), r'expected an \(n, 3\) .* shape \(99, 500\)$'),
    Case('image.npy', array(XYZ.reshape(20, -1, 3)), r'got shape \(20, 250, 3\)'),
    Case('beyond.npy', array(np.vstack([XYZ, [[1e300, 0, 0]]])), points=XYZ),
]


COMPACT = CompactConfig(voxel_size=0.5, max_range=1000)
GCL = encode(PointCloud(XYZ), COMPACT)
CELLS = np.unique(np.floor(XYZ / np.float32(0.5)).astype(int), axis=0)


def sealed(data):
    """A packed scan with the checksum that its bytes have."""
    checksum = zlib.crc32(data[SIZE:], zlib.crc32(data[: HEADER.size]))
    return data[: HEADER.size] + CHECKSUM.pack(checksum) + data[SIZE:]


GCLS = [
    Case('packed.gcl', GCL, points=(CELLS + 0.5) * 0.5),
    Case('PACKED.GCL', GCL, points=(CELLS + 0.5) * 0.5),
    Case('empty.gcl', b'', 'is no compact scan'),
    Case('cloud.gcl', rows(XYZ, INTENSITY), 'is no compact scan'),
    Case('cut.gcl', GCL[:-9], 'checksum does not fit'),
    Case('header_alone.gcl', GCL[:SIZE], 'checksum does not fit'),
    Case('half_a_header.gcl', GCL[:20], 'is no compact scan'),
    Case('one_bit.gcl', GCL[:200] + bytes([GCL[200] ^ 4]) + GCL[201:], 'checksum does not fit'),
    Case('as_text.gcl', GCL.replace(b'\n', b'\r\n') + b'\r\n', 'checksum does not fit'),
    Case('later.gcl', sealed(GCL[:4] + b'\2' + GCL[5:]), 'is a compact scan of format 2'),
    Case(
        'more_voxels.gcl',
        sealed(GCL[:24] + struct.pack('<I', len(CELLS) + 1) + GCL[28:]),
        'is damaged: .* voxels',
    ),
    Case(
        'huge.gcl', sealed(GCL[:24] + struct.pack('<I', 2**26) + GCL[28:]), 'has 67108864 voxels'
    ),
]


def made(case, folder):
    """Path of the file of a case."""
    path = folder / case.name
    path.write_bytes(case.data) if isinstance(case.data, bytes) else case.data(path)
    return path


@pytest.mark.parametrize('case', [*PCDS, *PLYS, *BINS, *NPYS, *GCLS], ids=lambda case: case.name)
def test_a_file_is_read_right_or_refused_by_name(case, tmp_path):
    path = made(case, tmp_path)
    if case.words:
        with pytest.raises(GclError, match=rf'{re.escape(case.name)}.*{case.words}'):
            read_cloud(path)
        return
    points, read = XYZ if case.points is None else case.points, read_cloud(path).points
    if case in GCLS:
        read = read[np.lexsort(read.T[::-1])]  # an octree keeps an order of its own
    np.testing.assert_allclose(read, points, rtol=2e-7)


@pytest.mark.parametrize('seed', range(3))
def test_columns_are_seen_whatever_the_order_of_the_points(seed, drive, tmp_path):
    points = np.random.default_rng(seed).permutation(drive.scan(90).points)
    intensity = (np.hypot(*points.T[:2]) % 1)[:, None]
    for columns in ((points, intensity), (points, intensity, intensity * 60 // 1)):
        (tmp_path / 'c.bin').write_bytes(rows(*columns))
        assert np.array_equal(read_cloud(tmp_path / 'c.bin').points, points)


def test_columns_are_named_and_can_be_told(tmp_path, caplog, capsys):
    (tmp_path / '1.bin').write_bytes(rows(XYZ, INTENSITY, RING))
    (tmp_path / '2.bin').write_bytes(rows(XYZ, INTENSITY, RING))
    np.savetxt(tmp_path / 'poses.txt', [np.eye(4)[:3].ravel()] * 2)
    sequence = open_sequence(tmp_path)
    assert len(sequence.scan(0)) == len(sequence.scan(1)) == N
    assert [record.getMessage().partition(';')[0] for record in caplog.records] == [
        f'{tmp_path}/1.bin is read as 5 columns of float32, as its numbers show'
    ]
    assert main(['inspect', '--data', str(tmp_path), '--scan', '0', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['columns'] == '5 columns of float32'
    assert len(read_cloud(tmp_path / '1.bin', BinLayout(10))) == N // 2
    assert len(open_sequence(tmp_path, columns=BinLayout(10)).scan(0)) == N // 2
