"""Packed scans as files: what comes back, that drives stay drives, what is refused."""

import json
import shutil

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.data.clouds import read_cloud, write_cloud
from gcl_core.data.formats import open_sequence
from gcl_core.data.kitti_writer import write_kitti
from gcl_core.evaluation import metrics
from gcl_core.types import PointCloud


@pytest.fixture
def scan(tmp_path, drive):
    path = tmp_path / 'scan.bin'
    write_cloud(path, drive.scan(90))
    return path


def test_a_scan_is_packed_and_says_how_far(scan, tmp_path, drive, capsys):
    out = tmp_path / 'PACKED.GCL'
    assert main(['pack', str(scan), str(out), '--json']) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts['before'] == scan.stat().st_size
    assert facts['after'] == out.stat().st_size < facts['before'] / 40
    back = read_cloud(out)
    assert facts['voxels'] == len(back)
    assert back.name == str(out)
    np.testing.assert_array_equal(back.points, decode(encode(drive.scan(90))).points)
    assert main(['pack', str(scan), str(out)]) == 0
    assert f'a scan, {len(back):,} voxels' in capsys.readouterr().out


def test_settings_are_those_told(scan, tmp_path, drive):
    out = tmp_path / 'a.gcl'
    settings = ['--voxel-size', '0.5', '--max-range', '30', '--residual-bits', '3']
    assert main(['pack', str(scan), str(out), *settings]) == 0
    expected = decode(encode(drive.scan(90), CompactConfig(0.5, 30.0, 3)))
    np.testing.assert_array_equal(read_cloud(out).points, expected.points)


@pytest.mark.parametrize('name', ['c.pcd', 'c.ply', 'c.npy', 'c.bin'])
def test_a_packed_scan_is_unpacked_for_other_programs(name, scan, tmp_path):
    packed, out = tmp_path / 'a.gcl', tmp_path / name
    assert main(['pack', str(scan), str(packed)]) == 0
    assert main(['unpack', str(packed), str(out)]) == 0
    np.testing.assert_array_equal(read_cloud(out).points, read_cloud(packed).points)


def test_packed_scans_register(tmp_path, drive, capsys):
    files = []
    for side, index in (('source', 98), ('target', 90)):
        files.append(str(tmp_path / f'{side}.gcl'))
        write_cloud(tmp_path / f'{side}.gcl', drive.scan(index))
    (tmp_path / 'fast.yaml').write_text('headings: 1\n')
    aligned = tmp_path / 'aligned.gcl'
    arguments = ['--config', str(tmp_path / 'fast.yaml'), '--aligned', str(aligned), '--json']
    assert main(['register', *files, *arguments]) == 0
    found = np.array(json.loads(capsys.readouterr().out)['T_target_source'])
    truth = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    assert metrics.registered(found, truth, metrics.STRICT)
    assert len(read_cloud(aligned)) > 1000


def test_a_folder_stays_a_drive(tmp_path, drive, write_folder, capsys):
    indices = (90, 95, 100)
    write_folder(tmp_path / 'a', drive, indices)
    (tmp_path / 'a/times.txt').write_text('0\n1\n2\n')
    out = tmp_path / 'packed'
    assert main(['pack', str(tmp_path / 'a'), str(out), '--json']) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts['scans'], facts['poses']) == (3, True)
    names = sorted(path.name for path in out.iterdir())
    assert names == ['100.gcl', '90.gcl', '95.gcl', 'poses.txt', 'times.txt']
    assert facts['after'] == sum(path.stat().st_size for path in out.glob('*.gcl'))
    packed, raw = open_sequence(out), open_sequence(tmp_path / 'a')
    assert len(packed) == 3
    for i, index in enumerate(indices):
        np.testing.assert_allclose(packed.T_world_lidar(i), raw.T_world_lidar(i), atol=1e-6)
        expected = decode(encode(drive.scan(index)))
        np.testing.assert_array_equal(packed.scan(i).points, expected.points)
    assert main(['inspect', '--data', str(out), '--pair', '1', '0']) == 0
    assert '5.1 m and' in capsys.readouterr().out
    assert main(['pack', str(tmp_path / 'a'), str(out)]) == 2
    assert 'exists already' in capsys.readouterr().err


def test_a_folder_without_poses_is_packed_without(tmp_path, drive, write_folder, capsys):
    write_folder(tmp_path / 'a', drive, (90, 95))
    (tmp_path / 'a/poses.txt').unlink()
    assert main(['pack', str(tmp_path / 'a'), str(tmp_path / 'p')]) == 0
    assert 'with poses' not in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / 'p').iterdir()) == ['90.gcl', '95.gcl']


def test_a_kitti_sequence_becomes_a_folder_with_its_poses(tmp_path, drive):
    indices = range(90, 93)
    write_kitti(tmp_path / 'k', '04', drive, indices, [0.0, 0.1, 0.2])
    out = tmp_path / 'packed'
    assert main(['pack', str(tmp_path / 'k'), str(out), '--sequence', '04']) == 0
    packed, raw = open_sequence(out), open_sequence(tmp_path / 'k')
    assert (out / '000002.gcl').is_file()
    assert len((out / 'times.txt').read_text().split()) == 3
    for i in range(3):
        np.testing.assert_allclose(packed.T_world_lidar(i), raw.T_world_lidar(i), atol=1e-6)


def test_real_scans_are_packed(real_root, tmp_path, capsys):
    first = real_root / 'sequences/80/velodyne/000000.bin'
    assert main(['pack', str(first), str(tmp_path / 'a.gcl'), '--json']) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts['before'] / facts['after'] > 100


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['pack', 'no.bin', 'a.gcl'], 'no file no.bin'),
        (['pack', 'no.bin', 'a.pcd'], 'a.pcd: a packed scan ends in .gcl; call it a.gcl'),
        (['pack', 'scan.bin', 'a.gcl', '--sequence', '08'], '--sequence is of a folder'),
        (['pack', 'scan.bin', 'a.gcl', '--voxel-size', '0'], 'voxel_size is 0 m; choose'),
        (['pack', 'scan.bin', 'a.gcl', '--residual-bits', '9'], 'residual_bits is 9; choose'),
        (['pack', 'far.npy', 'a.gcl'], 'far.npy: none of its 2 points lies within 100 m'),
        (['pack', 'twins', 'out'], 'two scans have the same name'),
        (['pack', 'poses_alone', 'out'], 'neither a folder of clouds nor a KITTI sequence'),
        (['pack', 'broken', 'out'], '2.npy is not a .npy file'),
        (['unpack', 'scan.bin', 'a.pcd'], 'scan.bin is no packed scan'),
        (['unpack', 'no.gcl', 'a.gcl'], 'a.gcl would be packed again'),
        (['unpack', 'no.gcl', 'a.pcd'], 'no file no.gcl'),
    ],
)
def test_what_cannot_be_packed_is_refused_and_nothing_is_left(
    arguments, message, scan, tmp_path, drive, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    np.save('far.npy', np.full((2, 3), 500.0))
    for folder in ('twins', 'broken'):
        (tmp_path / folder).mkdir()
        np.save(f'{folder}/1.npy', np.ones((5, 3)))
    shutil.copy('twins/1.npy', 'twins/1.NPY')
    (tmp_path / 'broken/2.npy').write_bytes(b'nothing')
    write_kitti(tmp_path / 'poses_alone', '04', drive, [90], [0.0])
    shutil.rmtree('poses_alone/sequences/04/velodyne')
    before = sorted(tmp_path.rglob('*'))
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
    assert sorted(tmp_path.rglob('*')) == before


def test_writing_and_reading_a_cloud_as_gcl(tmp_path):
    points = np.random.default_rng(0).normal(0, 9, (50, 3)).astype(np.float32)
    write_cloud(tmp_path / 'c.gcl', PointCloud(points), CompactConfig(0.05, residual_bits=6))
    back = read_cloud(tmp_path / 'c.gcl').points
    assert len(back) == 50
    away = np.linalg.norm(back[:, None] - points, axis=2).min(1)
    assert away.max() < 0.05 / 2**6
