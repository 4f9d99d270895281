"""Clouds on disk, simulated scans, and pairs of them."""

import numpy as np
import open3d as o3d
import pytest

from gcl_core import se3
from gcl_core.data.clouds import read_cloud, write_cloud
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.pairs import draw_pairs
from gcl_core.data.sequence import T_target_source
from gcl_core.data.simulator.sensors import sensor_named
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.types import PointCloud


def test_real_sequence_reads(real_root):
    sequence = KittiSequence(real_root, '80')
    assert len(sequence) == 52
    assert len(sequence.scan(0)) > 100_000


@pytest.mark.parametrize('suffix', ['.bin', '.npy', '.pcd', '.ply'])
def test_clouds_survive_a_round_trip(tmp_path, suffix):
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    write_cloud(tmp_path / f'c{suffix}', PointCloud(points))
    np.testing.assert_allclose(read_cloud(tmp_path / f'c{suffix}').points, points, atol=1e-6)


N = 5000
XYZ = np.random.default_rng(5).normal(0, 20, (N, 3)).astype(np.float32)


@pytest.mark.parametrize('ascii_', [True, False])
@pytest.mark.parametrize('name', ['c.pcd', 'compressed.pcd', 'c.ply'])
def test_what_another_program_writes_is_read(name, ascii_, tmp_path):
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(XYZ))
    cloud.point['intensity'] = o3d.core.Tensor(XYZ[:, :1])
    packs = name.startswith('compressed')
    o3d.t.io.write_point_cloud(
        str(tmp_path / name), cloud, write_ascii=ascii_ and not packs, compressed=packs
    )
    np.testing.assert_allclose(read_cloud(tmp_path / name).points, XYZ, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize('name', ['c.pcd', 'c.ply', 'C.PCD', 'C.NPY'])
def test_what_is_written_another_program_reads(name, tmp_path):
    write_cloud(tmp_path / name, PointCloud(XYZ))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    if name.endswith('NPY'):
        assert np.array_equal(np.load(tmp_path / name), XYZ)
    elif name.islower():
        read = o3d.t.io.read_point_cloud(str(tmp_path / name)).point['positions']
        assert np.array_equal(read.numpy(), XYZ)


def test_compressed_repeats_are_read(tmp_path):
    """What refers to what it writes itself, far back and near, long and short."""
    points = np.tile(XYZ[:7], (N // 7, 1))
    points[: N // 2] = 0.25
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points))
    o3d.t.io.write_point_cloud(str(tmp_path / 'c.pcd'), cloud, compressed=True)
    assert (tmp_path / 'c.pcd').stat().st_size < points.nbytes / 3
    assert np.array_equal(read_cloud(tmp_path / 'c.pcd').points, points)


def test_points_that_are_not_finite_are_dropped(tmp_path):
    points = np.zeros((4, 3), np.float32)
    points[1, 2] = np.nan
    points[2, 0] = np.inf
    np.save(tmp_path / 'c.npy', points)
    assert len(read_cloud(tmp_path / 'c.npy')) == 2


@pytest.mark.parametrize(
    ('name', 'content', 'message'),
    [
        ('missing.bin', None, 'no file'),
        ('cut.bin', b'12345', 'multiple of 16'),
        ('empty.bin', b'', 'no points'),
        ('text.npy', b'hello', 'not a .npy'),
        ('text.pcd', b'hello', 'has no .pcd header'),
        ('text.ply', b'hello', 'has no .ply header'),
        ('cloud.las', b'', 'unknown format'),
    ],
)
def test_broken_clouds_are_named(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(GclError, match=message):
        read_cloud(path)


def test_all_nan_and_wrong_shape_are_named(tmp_path):
    np.save(tmp_path / 'nan.npy', np.full((5, 3), np.nan))
    np.save(tmp_path / 'flat.npy', np.zeros(7))
    with pytest.raises(GclError, match='none of its 5 points is finite'):
        read_cloud(tmp_path / 'nan.npy')
    with pytest.raises(GclError, match=r'got shape \(7,\)'):
        read_cloud(tmp_path / 'flat.npy')


def test_simulated_scans_agree_with_their_poses(drive):
    """Two scans 6 m apart, aligned by their poses, lie on each other; unaligned they do not."""
    from scipy.spatial import cKDTree

    target, source = drive.scan(90), drive.scan(96)
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(96)
    tree = cKDTree(target.points)
    high = source.points[source.points[:, 2] > -1.0][::10]
    aligned = np.median(tree.query(se3.transform(T, high))[0])
    assert aligned < 0.12
    assert aligned < 0.5 * np.median(tree.query(high)[0])


def test_simulation_follows_from_the_seed(drive):
    again = SimulatedSequence(3)
    np.testing.assert_array_equal(again.scan(90).points, drive.scan(90).points)
    assert not np.array_equal(
        SimulatedSequence(4).scan(90).points[:10], drive.scan(90).points[:10]
    )


def test_oncoming_vehicle_looks_the_other_way_in_the_same_world(drive):
    oncoming = SimulatedSequence(3, route='oncoming')
    T = se3.inverse(drive.T_world_lidar(90)) @ oncoming.T_world_lidar(90)
    assert abs(abs(se3.yaw(T)) - np.pi) < 0.3
    assert 1.0 < np.linalg.norm(T[:3, 3]) < 15.0


def test_unknown_sensor_is_named():
    with pytest.raises(GclError, match="unknown sensor 'vlp99'"):
        sensor_named('vlp99')


def test_pairs_lie_in_their_bins(drive):
    pairs = draw_pairs(drive, per_bin=5)
    assert len(pairs) == 25
    for pair in pairs:
        T = T_target_source(drive, source=pair.source, target=pair.target)
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(pair.distance)
        assert pair.bin[0] <= pair.distance < pair.bin[1]
    assert pairs == draw_pairs(drive, per_bin=5)
