"""Every reader on a small tree in the real layout, written here, with simulated scans."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.config import load_config
from gcl_core.data.clouds import write_cloud
from gcl_core.data.eth import EthSequence
from gcl_core.data.folder import FolderSequence
from gcl_core.data.formats import open_sequence, open_sequences, sequence_names
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.nuscenes import read_logs
from gcl_core.data.poses import read_poses
from gcl_core.data.sequence import positions
from gcl_core.errors import GclError
from gcl_core.evaluation.benchmark import BenchmarkConfig
from gcl_core.evaluation.contestants import check_weights
from gcl_core.evaluation.published import published
from gcl_core.registrar import RegistrarConfig
from gcl_core.training.recipe import TrainConfig
from gcl_core.types import PointCloud

SCANS = (90, 92, 94)
CONFIG = Path(__file__).parents[2] / 'config'


def line(T):
    return ' '.join(f'{x:.9g}' for x in T[:3].ravel()) + '\n'


def close(T, expected):
    np.testing.assert_allclose(T, expected, atol=1e-5)


def relative(sequence, target, source):
    return se3.inverse(sequence.T_world_lidar(target)) @ sequence.T_world_lidar(source)


def aligned(sequence, target, source):
    """Mean distance of high points after alignment by the poses, metres."""
    from scipy.spatial import cKDTree

    cloud = sequence.scan(source).points.astype(float)
    moved = se3.transform(relative(sequence, target, source), cloud[cloud[:, 2] > -1.0][::10])
    return np.median(cKDTree(sequence.scan(target).points).query(moved)[0])


@pytest.fixture(scope='module')
def scans(drive):
    return [drive.scan(i) for i in SCANS]


@pytest.fixture(scope='module')
def poses(drive):
    return [drive.T_world_lidar(i) for i in SCANS]


# KITTI with SemanticKITTI's poses

TR = np.array([[0, -1, 0, 0.1], [0, 0, -1, 0.2], [1, 0, 0, -0.3], [0, 0, 0, 1.0]])


@pytest.fixture
def kitti(tmp_path, scans, poses):
    folder = tmp_path / 'sequences' / '08'
    (folder / 'velodyne').mkdir(parents=True)
    (tmp_path / 'poses').mkdir()
    for i, cloud in enumerate(scans):
        write_cloud(folder / 'velodyne' / f'{i:06d}.bin', cloud)
    numbers = ' '.join(str(x) for x in TR[:3].ravel())
    (folder / 'calib.txt').write_text(f'P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: {numbers}\n')
    (folder / 'times.txt').write_text('0.0\n0.1\n0.2\n')
    camera = [TR @ T @ se3.inverse(TR) for T in poses]
    (tmp_path / 'poses/08.txt').write_text(''.join(line(T) for T in camera))
    shifted = [se3.from_xyz_rpy(x=5.0) @ T for T in camera]
    (folder / 'poses.txt').write_text(''.join(line(T) for T in shifted))
    return tmp_path


def test_kitti_applies_tr_to_both_kinds_of_poses(kitti, poses):
    own = KittiSequence(kitti, '08')
    suma = KittiSequence(kitti, '08', poses='semantickitti')
    assert (own.name, suma.name) == ('kitti/08', 'kitti/08-suma')
    for i, T in enumerate(poses):
        close(own.T_world_lidar(i), T)
        # 5 m along the camera's x are -5 m along the LiDAR's y
        close(suma.T_world_lidar(i), se3.from_xyz_rpy(y=-5.0) @ T)
    assert aligned(own, 0, 2) < 0.15
    assert own.stamp(2) == pytest.approx(0.2)


def test_kitti_takes_the_poses_that_exist(kitti):
    assert open_sequence(kitti, '08-suma').name == 'kitti/08-suma'
    (kitti / 'poses/08.txt').unlink()
    assert open_sequence(kitti).name == 'kitti/08-suma'
    assert open_sequence(kitti / 'sequences/08').name == 'kitti/08-suma'
    with pytest.raises(GclError, match=r'no file .*poses/08\.txt'):
        KittiSequence(kitti, '08', poses='kitti')


@pytest.mark.parametrize(
    ('file', 'content', 'message'),
    [
        ('calib.txt', 'Tr: 1 2 x\n', 'Tr: could not convert'),
        ('calib.txt', 'Tr: 1 2 3\n', 'Tr has 3 numbers, expected 12'),
        ('poses.txt', '1 0 0 0 0 1 0 0 0 0 1 0\n', '3 scans but 1 poses'),
        ('poses.txt', '2 0 0 0 0 1 0 0 0 0 1 0\n' * 3, 'line 1: .* no rotation'),
        ('poses.txt', '1 0 0 nan 0 1 0 0 0 0 1 0\n' * 3, 'not finite'),
        ('poses.txt', 'one two\n', 'could not convert'),
    ],
)
def test_broken_kitti_files_are_named(kitti, file, content, message):
    (kitti / 'sequences/08' / file).write_text(content)
    with pytest.raises(GclError, match=message):
        KittiSequence(kitti, '08', poses='semantickitti')


def test_kitti_times_are_read_when_asked_for(kitti):
    (kitti / 'sequences/08/times.txt').write_text('0.0\n')
    sequence = KittiSequence(kitti, '08')
    with pytest.raises(GclError, match='1 times for 3 scans'):
        sequence.stamp(0)


def test_kitti_root_with_several_sequences_asks_which(kitti):
    shutil.copytree(kitti / 'sequences/08', kitti / 'sequences/09')
    with pytest.raises(GclError, match='name one of 08, 09'):
        open_sequence(kitti)
    with pytest.raises(GclError, match=r'no folder .*sequences/11'):
        open_sequence(kitti, '11')


# nuScenes

T_EGO_SENSOR = se3.from_xyz_rpy(0.94, 0.0, 1.84, yaw=-1.5)
TO_SENSOR = se3.from_xyz_rpy(yaw=np.pi / 2)  # KITTI's axes to the sensor's: x right, y forward


def quaternion(T):
    x, y, z, w = se3.to_quaternion(T[:3, :3])
    return {'rotation': [w, x, y, z], 'translation': T[:3, 3].tolist()}


@pytest.fixture
def nuscenes(tmp_path, scans, poses):
    """Two scenes of one log listed in the wrong order, and a sweep and a camera beside them."""
    (tmp_path / 'samples/LIDAR_TOP').mkdir(parents=True)
    tables = tmp_path / 'v1.0-mini'
    tables.mkdir()
    sample, data, ego = [], [], []
    for i, (cloud, T) in enumerate(zip(scans, poses, strict=True)):
        name = f'samples/LIDAR_TOP/log__{i}.pcd.bin'
        rows = np.zeros((len(cloud), 5), np.float32)
        rows[:, :3] = se3.transform(TO_SENSOR, cloud.points)
        rows.tofile(tmp_path / name)
        T_world_ego = T @ se3.inverse(TO_SENSOR) @ se3.inverse(T_EGO_SENSOR)
        ego.append({'token': f'e{i}', 'timestamp': i, **quaternion(T_world_ego)})
        sample.append({'token': f's{i}', 'scene_token': 'late' if i == 2 else 'early'})
        row = {
            'token': f'd{i}',
            'sample_token': f's{i}',
            'ego_pose_token': f'e{i}',
            'calibrated_sensor_token': 'lidar',
            'timestamp': 1_000_000 + 500_000 * i,
            'is_key_frame': True,
            'filename': name,
        }
        data += [
            row,
            {**row, 'token': f'w{i}', 'is_key_frame': False, 'filename': 'sweeps/LIDAR_TOP/x'},
            {**row, 'token': f'c{i}', 'filename': 'samples/CAM_FRONT/x.jpg'},
        ]
    content = {
        'sample': sample,
        'sample_data': data[::-1],
        'ego_pose': ego,
        'calibrated_sensor': [{'token': 'lidar', **quaternion(T_EGO_SENSOR)}],
        'scene': [{'token': t, 'log_token': 'L'} for t in ('late', 'early')],
        'log': [{'token': 'L', 'logfile': 'n015-2018'}],
    }
    for name, rows in content.items():
        (tables / f'{name}.json').write_text(json.dumps(rows))
    return tmp_path


def test_nuscenes_scans_and_poses_have_kittis_axes(nuscenes, scans, poses):
    (sequence,) = read_logs(nuscenes).values()
    assert sequence.name == 'nuscenes/n015-2018'
    assert len(sequence) == 3
    for i in range(3):
        np.testing.assert_allclose(sequence.scan(i).points, scans[i].points, atol=1e-4)
        close(sequence.T_world_lidar(i), poses[i])
    assert sequence.stamp(2) == pytest.approx(1.0)
    assert aligned(sequence, 0, 2) < 0.15
    assert open_sequence(nuscenes).name == open_sequence(nuscenes, 'n015-2018').name


def test_nuscenes_forward_is_x(tmp_path, nuscenes):
    ahead = np.zeros((1, 5), np.float32)
    ahead[0, 1] = 7.0  # the sensor's y
    ahead.tofile(nuscenes / 'samples/LIDAR_TOP/log__0.pcd.bin')
    np.testing.assert_allclose(open_sequence(nuscenes).scan(0).points, [[7, 0, 0]], atol=1e-6)


@pytest.mark.parametrize(
    ('table', 'content', 'message'),
    [
        ('ego_pose', None, 'no file .*ego_pose.json'),
        ('ego_pose', '[]', "ego_pose.json has no row 'e0'"),
        ('scene', '[{"token": "early", "log_token": "M"}]', "log.json has no row 'M'"),
        ('sample_data', '[{"token": "x"}]', "lacks 'is_key_frame'"),
        ('sample_data', '[]', 'lists no key frame'),
        ('log', '{', 'is not valid JSON'),
        ('log', '[1]', 'not a nuScenes table'),
    ],
)
def test_broken_nuscenes_tables_are_named(nuscenes, table, content, message):
    path = nuscenes / 'v1.0-mini' / f'{table}.json'
    path.unlink() if content is None else path.write_text(content)
    with pytest.raises(GclError, match=message):
        read_logs(nuscenes)


def test_broken_nuscenes_files_are_named(nuscenes, tmp_path_factory):
    sequence = open_sequence(nuscenes)
    (nuscenes / 'samples/LIDAR_TOP/log__1.pcd.bin').write_bytes(b'0' * 41)
    (nuscenes / 'samples/LIDAR_TOP/log__2.pcd.bin').unlink()
    with pytest.raises(GclError, match='not a multiple of 20'):
        sequence.scan(1)
    with pytest.raises(GclError, match='download the key frames'):
        sequence.scan(2)
    with pytest.raises(GclError, match=r"'other' is not there; there are n015-2018"):
        open_sequence(nuscenes, 'other')
    shutil.copytree(nuscenes / 'v1.0-mini', nuscenes / 'v1.0-trainval')
    with pytest.raises(GclError, match=r'versions v1\.0-mini, v1\.0-trainval; choose one'):
        read_logs(nuscenes)
    assert len(open_sequence(nuscenes / 'v1.0-mini')) == 3
    with pytest.raises(GclError, match=r'no .*v1\.0-\*/sample_data'):
        read_logs(tmp_path_factory.mktemp('empty'))


# ETH


def entry(i, j, T):
    return f'{i}\t{j}\t3\n' + ''.join('\t'.join(str(x) for x in row) + '\n' for row in T)


@pytest.fixture
def eth(tmp_path, scans, poses):
    """Clouds 0-1 and 2-1 are linked, 0-2 is not."""
    folder = tmp_path / 'wood_autmn'
    folder.mkdir()
    for i, cloud in enumerate(scans):
        write_cloud(folder / f'Hokuyo_{i}.ply', cloud)
    links = [(i, j, se3.inverse(poses[i]) @ poses[j]) for i, j in ((0, 1), (2, 1))]
    (folder / 'gt.log').write_text(''.join(entry(*link) for link in links))
    return folder


def test_eth_poses_are_chained_from_the_log(eth, poses, scans):
    sequence = EthSequence(eth)
    assert len(sequence) == 3
    assert set(sequence.links) == {(0, 1), (2, 1)}
    close(sequence.T_world_lidar(0), np.eye(4))
    for i in (1, 2):
        close(sequence.T_world_lidar(i), se3.inverse(poses[0]) @ poses[i])
    np.testing.assert_allclose(sequence.scan(2).points, scans[2].points, atol=1e-5)
    assert aligned(sequence, 0, 2) < 0.15
    for path in (eth, eth.parent):
        assert open_sequence(path).name == 'eth/wood_autmn'


def test_broken_eth_scenes_are_named(eth):
    log = (eth / 'gt.log').read_text()
    (eth / 'gt.log').write_text(entry(0, 1, np.eye(4)))
    with pytest.raises(GclError, match='does not link cloud 2'):
        EthSequence(eth).T_world_lidar(2)
    for content, message in [
        ('\n'.join(log.splitlines()[:8]), r'entry 1: expected a 4x4 matrix, got \(2, 4\)'),
        ('0 1 3\n1 2\n', 'expected a 4x4 matrix'),
        (entry(0, 7, np.eye(4)), 'links 0 and 7, but there are 3 clouds'),
        ('a b c\n', 'entry 0: invalid literal'),
    ]:
        (eth / 'gt.log').write_text(content)
        with pytest.raises(GclError, match=message):
            EthSequence(eth)
    (eth / 'gt.log').unlink()
    with pytest.raises(GclError, match=r'no file .*gt\.log'):
        EthSequence(eth)
    (eth / 'Hokuyo_1.ply').unlink()
    with pytest.raises(GclError, match=r'no file .*Hokuyo_1\.ply'):
        EthSequence(eth)
    with pytest.raises(GclError, match=r'no Hokuyo_0\.ply'):
        EthSequence(eth.parent)


# Plain folders


@pytest.fixture(params=['.bin', '.pcd', '.ply', '.npy'])
def folder(tmp_path, request, scans):
    for i, cloud in zip((2, 10, 9), scans, strict=True):
        write_cloud(tmp_path / f'scan{i}{request.param}', cloud)
    return tmp_path


def test_folder_is_in_the_order_of_numbers(folder, scans, poses):
    sequence = open_sequence(folder)
    order = (0, 2, 1)  # scan2, scan9, scan10
    for i, original in enumerate(order):
        np.testing.assert_allclose(sequence.scan(i).points, scans[original].points, atol=1e-5)
    with pytest.raises(GclError, match=r'no file .*poses\.txt: these clouds have no poses'):
        positions(sequence)
    (folder / 'poses.txt').write_text(''.join(line(poses[i]) for i in order))
    sequence = open_sequence(folder)
    close(sequence.T_world_lidar(1), poses[2])


def test_broken_folders_are_named(tmp_path):
    with pytest.raises(GclError, match='no cloud in'):
        FolderSequence(tmp_path)
    with pytest.raises(GclError, match='cannot list'):
        FolderSequence(tmp_path / 'none')
    cloud = PointCloud(np.ones((3, 3), np.float32))
    write_cloud(tmp_path / 'a.npy', cloud)
    (tmp_path / 'poses.txt').write_text(line(np.eye(4)) * 2)
    with pytest.raises(GclError, match='2 poses for 1 clouds'):
        FolderSequence(tmp_path)
    write_cloud(tmp_path / 'b.pcd', cloud)
    with pytest.raises(GclError, match=r'mixes \.npy and \.pcd'):
        FolderSequence(tmp_path)


# All of them


def test_a_single_drive_is_not_taken_for_another(folder, kitti, eth):
    for path, own in ((folder, folder.name), (kitti / 'sequences/08', '08'), (eth, eth.name)):
        layout = 'folder' if path == folder else None
        assert open_sequence(path, own, layout=layout).name.endswith(own)
        with pytest.raises(GclError, match=f"'other' is not there; there are {own}"):
            open_sequence(path, 'other', layout=layout)
    assert open_sequence(kitti / 'sequences/08', '08-suma').name == 'kitti/08-suma'


def test_several_are_opened_by_name(kitti, eth):
    shutil.copytree(kitti / 'sequences/08', kitti / 'sequences/09')
    opened = open_sequences(kitti, ['08', '09-suma'])
    assert {name: s.name for name, s in opened.items()} == {
        '08': 'kitti/08',
        '09-suma': 'kitti/09-suma',
    }
    assert sequence_names(kitti) == ['08', '09']
    assert sequence_names(kitti / 'sequences/08') == ['08']
    assert list(open_sequences(eth)) == ['wood_autmn']
    assert sequence_names(eth.parent, layout='eth') == ['wood_autmn']
    shutil.copytree(eth, eth.parent / 'gazebo_summer')
    assert len(open_sequences(eth.parent, ['gazebo_summer', 'wood_autmn'], layout='eth')) == 2
    with pytest.raises(GclError, match="ETH scene 'stairs' is not there; there are gazebo_summer"):
        open_sequence(eth.parent, 'stairs', layout='eth')


def test_layout_can_be_told(folder):
    assert open_sequence(folder, layout='folder').name == f'folder/{folder.name}'
    with pytest.raises(GclError, match='KITTI odometry is laid out as'):
        open_sequence(folder, '08', layout='kitti')
    with pytest.raises(GclError, match="unknown format 'las'"):
        open_sequence(folder, layout='las')


def test_unknown_layouts_list_the_known_ones(tmp_path):
    (tmp_path / 'notes.md').write_text('')
    with pytest.raises(GclError, match=r'expected one of\n.*kitti(.|\n)*rosbag2'):
        open_sequence(tmp_path)
    with pytest.raises(GclError, match='no folder'):
        open_sequence(tmp_path / 'none')


def test_poses_of_another_width_are_named(tmp_path):
    (tmp_path / 'p.txt').write_text('0 0 0 0 0 0 1\n')
    with pytest.raises(GclError, match='expected 12 numbers a line, got 7'):
        read_poses(tmp_path / 'p.txt')


# The benchmarks of the paper on their data sets' layouts


@pytest.mark.parametrize(
    ('name', 'layout', 'sequences', 'listed'),
    [
        ('kitti', 'kitti', ['08-suma'], '08-suma'),
        ('lokitti', 'kitti', ['08-suma'], '8'),  # as the public list names it
        ('nuscenes', 'nuscenes', None, 'n015-2018'),
        ('lonuscenes', 'nuscenes', None, 'n015-2018'),
    ],
)
def test_benchmarks_run_on_their_layout(
    request, tmp_path_factory, name, layout, sequences, listed
):
    root, out = request.getfixturevalue(layout), tmp_path_factory.mktemp(name)
    (out / 'list.txt').write_text(f'{listed} 1 0\n')
    content = yaml.safe_load((CONFIG / f'bench_{name}.yaml').read_text())
    content['methods'] = [{'kind': 'peer', 'name': 'gicp'}]
    (out / 'bench.yaml').write_text(yaml.safe_dump(content))
    arguments = ['--config', str(out / 'bench.yaml'), '--data', str(root), '--out', str(out / 'o')]
    arguments += ['--pairs', str(out / 'list.txt')]
    arguments += ['--sequence', *sequences] if sequences else []
    assert main(['evaluate', *arguments]) == 0
    results = json.loads((out / 'o/results.json').read_text())
    assert [row['strict'] for row in results['rows']] == [1]
    assert results['sequences'] == [f'{layout}/{"08-suma" if sequences else listed}']
    assert [table['name'] for table in results['published']] == content.get('published', [])


def test_eth_is_scored_by_its_links(eth, tmp_path_factory):
    out = tmp_path_factory.mktemp('out')
    content = yaml.safe_load((CONFIG / 'bench_eth.yaml').read_text())
    content['methods'] = [{'voxel_size': 0.25}]  # the tiny tree is of street scans
    (out / 'bench.yaml').write_text(yaml.safe_dump(content))
    arguments = ['--config', str(out / 'bench.yaml'), '--data', str(eth.parent)]
    assert main(['evaluate', *arguments, '--out', str(out / 'o')]) == 0
    results = json.loads((out / 'o/results.json').read_text())
    scene, mean = results['figures'][0]['rows']
    assert (scene['scene'], scene['pairs']) == ('wood_autmn', 2)
    assert mean['fmr_percent'] == scene['fmr_percent']
    assert scene['mean_inlier_percent'] > 1  # 4 m apart
    assert 'voxels of 0.25 m' in results['figures'][0]['caption']


@pytest.mark.parametrize('path', sorted(CONFIG.glob('bench_*.yaml')), ids=lambda p: p.stem)
def test_benchmarks_name_recipes_that_exist(path):
    config = load_config(BenchmarkConfig, path)
    assert [published(name).name for name in config.published] == list(config.published)
    for method in config.methods:
        if recipe := getattr(method, 'trained_by', ''):
            file, *settings = recipe.split()
            load_config(TrainConfig, CONFIG.parent / file, settings[1:])
            assert settings[:1] in ([], ['--set'])
            with pytest.raises(GclError, match=f'gcl train --config {file}'):
                check_weights(replace(method, registrar=RegistrarConfig(weights='no.safetensors')))
