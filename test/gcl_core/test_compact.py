"""Compact scans: what comes back, how large they are, what damaged ones do."""

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gcl_core.compact import octree
from gcl_core.compact.priors import priors
from gcl_core.compact.scan import CHECKSUM, HEADER, SIZE, CompactConfig, decode, encode
from gcl_core.data.simulator.sensors import SENSORS
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.types import PointCloud


def cloud(*points) -> PointCloud:
    return PointCloud(np.array(points, np.float32).reshape(-1, 3))


def rows(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.T)]


def nearest_centres(points: np.ndarray, config: CompactConfig) -> np.ndarray:
    """What is expected of a scan: the centre of each voxel that a point lies in."""
    near = points[(points**2).sum(1) <= config.max_range**2]
    cells = np.unique(np.floor(near / np.float32(config.voxel_size)).astype(int), axis=0)
    return ((cells + 0.5) * config.voxel_size).astype(np.float32)


def resealed(data: bytes) -> bytes:
    """Give changed bytes a checksum that fits."""
    checksum = zlib.crc32(data[SIZE:], zlib.crc32(data[: HEADER.size]))
    return data[: HEADER.size] + CHECKSUM.pack(checksum) + data[SIZE:]


@pytest.mark.parametrize('sensor', SENSORS)
def test_each_voxel_of_a_sensor_comes_back_once(sensor):
    scan = SimulatedSequence(51, sensor=sensor).scan(90)
    data = encode(scan)
    back = decode(data).points
    np.testing.assert_allclose(
        rows(back), rows(nearest_centres(scan.points, CompactConfig())), atol=1e-5
    )
    assert len(data) * 8 / len(back) < 6  # bits a voxel; 48 as three float16


@pytest.mark.parametrize(
    'points',
    [
        [(1.0, 2.0, 3.0)],
        [(0.0, 0.0, 0.0), (-0.01, -0.01, -0.01)],
        [(-99.0, 0.0, 0.0), (99.0, 0.0, 0.0), (0.0, 0.0, 60.0)],
        [(1.0, 2.0, 3.0)] * 300,
    ],
    ids=['one', 'about the origin', 'far outliers', 'one voxel many times'],
)
def test_odd_scans(points):
    scan = cloud(*points)
    back = decode(encode(scan)).points
    expected = nearest_centres(scan.points, CompactConfig())
    np.testing.assert_allclose(rows(back), rows(expected), atol=1e-5)


def test_points_beyond_the_range_are_left_out():
    scan = cloud((1, 0, 0), (200, 0, 0))
    assert len(decode(encode(scan))) == 1
    assert len(decode(encode(scan, CompactConfig(max_range=300)))) == 2
    with pytest.raises(GclError, match='none of its 1 points'):
        encode(cloud((200, 0, 0)))


@pytest.mark.parametrize('bits', [1, 3, 8])
def test_residuals_say_where_in_a_voxel(bits):
    scan = SimulatedSequence(52, sensor='vlp16').scan(80)
    config = CompactConfig(residual_bits=bits, voxel_size=0.5)
    back = rows(decode(encode(scan, config)).points)
    centres = rows(decode(encode(scan, CompactConfig(voxel_size=0.5))).points)
    assert len(back) == len(centres)
    own = scan.points[(scan.points**2).sum(1) < config.max_range**2]
    cells = np.floor(own / 0.5).astype(int)
    _, group = np.unique(cells, axis=0, return_inverse=True)
    means = np.stack([np.bincount(group, own[:, i]) for i in range(3)], 1)
    means /= np.bincount(group)[:, None]
    away, _ = cKDTree(means).query(back)
    assert away.max() <= np.sqrt(3) * 0.25 / 2**bits + 1e-3


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(*[st.integers(0, 30)] * 3), min_size=1, max_size=60), st.integers(5, 7))
def test_any_voxels_come_back_by_both_coders(cells, depth):
    keys = np.unique([octree.pack(*cell) for cell in cells])
    written = octree._encode(keys, depth, priors())
    compiled = octree.native.encode(keys, depth, priors())
    assert compiled in (None, written)
    for found in (
        octree._decode(written, depth, len(keys), priors()),
        octree.decode(written, depth, len(keys), priors()),
    ):
        assert np.array_equal(found, keys)


def test_a_real_sized_scan_is_the_same_by_both_coders():
    scan = SimulatedSequence(53, sensor='vlp16').scan(90)
    data = encode(scan, CompactConfig(voxel_size=0.5))
    head = HEADER.unpack_from(data)
    depth, count = head[3], head[-1]
    keys = octree.decode(data[SIZE:], depth, count, priors())
    assert octree._encode(keys, depth, priors()) == data[SIZE:]
    assert np.array_equal(octree._decode(data[SIZE:], depth, count, priors()), keys)


def test_many_points():
    generator = np.random.default_rng(1)
    scan = PointCloud(generator.uniform(-60, 60, (300_000, 3)).astype(np.float32))
    assert len(decode(encode(scan))) == len(nearest_centres(scan.points, CompactConfig()))


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (lambda d: b'', 'no compact scan'),
        (lambda d: b'GCLX' + d[4:], 'no compact scan'),
        (lambda d: d[:20], 'no compact scan'),
        (lambda d: d[:4] + b'\x09' + d[5:], 'format 9, this version reads 1'),
        (lambda d: d[:-3], 'checksum does not fit'),
        (lambda d: d[:60] + bytes([d[60] ^ 1]) + d[61:], 'checksum does not fit'),
        (lambda d: resealed(d[:5] + b'\x07' + d[6:]), 'cut off|voxels'),
        (lambda d: resealed(d[:6] + b'\x1f' + d[7:]), 'header says'),
        (lambda d: resealed(d[:8] + b'\0\0\xc0\x7f' + d[12:]), 'header says'),
        (lambda d: resealed(d[:24] + b'\0\0\0\0' + d[28:]), 'header says 0 voxels'),
        (lambda d: resealed(d[:24] + b'\xff\xff\xff\0' + d[28:]), 'are read at most'),
        (lambda d: resealed(d[:24] + b'\x10\0\0\0' + d[28:]), 'does not hold the 16 voxels'),
        (lambda d: resealed(d[:SIZE]), 'does not hold'),
    ],
)
def test_what_is_damaged_is_refused(change, words):
    data = encode(SimulatedSequence(54, sensor='vlp16').scan(90), CompactConfig(voxel_size=1.0))
    with pytest.raises(GclError, match=words):
        decode(change(data), 'message on /a')


@settings(deadline=None, max_examples=200)
@given(st.binary(max_size=200), st.integers(0, 15), st.integers(1, 5000))
def test_hostile_bytes_end_within_their_count(data, depth, count):
    try:
        keys = octree.decode(data, depth, count, priors())
    except GclError:
        return
    assert len(keys) <= count


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'voxel_size': 0.0}, 'voxel_size is 0 m'),
        ({'max_range': 1e9}, r'max_range is 1e\+09'),
        ({'residual_bits': 9}, 'residual_bits is 9'),
    ],
)
def test_settings_out_of_range(change, words):
    with pytest.raises(GclError, match=words):
        CompactConfig(**change)


def test_voxels_too_small_for_the_range():
    with pytest.raises(GclError, match='larger voxels'):
        encode(cloud((-500, 0, 0), (500, 0, 0)), CompactConfig(voxel_size=0.01, max_range=1000))
