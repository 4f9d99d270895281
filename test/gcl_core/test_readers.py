"""Every reader on a small tree in the real layout, with simulated scans."""

import json
import shutil

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.data.clouds import read_cloud, write_cloud
from gcl_core.data.eth import EthSequence
from gcl_core.data.folder import FolderSequence
from gcl_core.data.formats import open_sequence, open_sequences, sequence_names
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.nuscenes import read_logs
from gcl_core.data.poses import read_poses
from gcl_core.data.sequence import T_target_source, positions
from gcl_core.errors import GclError
from gcl_core.types import PointCloud


def close(T, expected):
    np.testing.assert_allclose(T, expected, atol=1e-5)


def aligned(sequence, target, source):
    """Mean distance of high points after alignment by the poses, metres."""
    from scipy.spatial import cKDTree

    cloud = sequence.scan(source).points.astype(float)
    T = T_target_source(sequence, source=source, target=target)
    moved = se3.transform(T, cloud[cloud[:, 2] > -1.0][::10])
    return np.median(cKDTree(sequence.scan(target).points).query(moved)[0])


# KITTI with SemanticKITTI's poses


def test_kitti_applies_tr_to_both_kinds_of_poses(kitti, poses):
    own = KittiSequence(kitti, '08')
    suma = KittiSequence(kitti, '08', poses='semantickitti')
    assert (own.name, suma.name) == ('kitti/08', 'kitti/08-suma')
    for i, T in enumerate(poses):
        close(own.T_world_lidar(i), T)
        # 5 m along the camera's x are -5 m along the LiDAR's y
        close(suma.T_world_lidar(i), se3.from_xyz_rpy(y=-5.0) @ T)
    assert aligned(own, 0, 2) < 0.15


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
        ('calib.txt', 'P0: 1\n', 'no line `Tr:`'),
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


def test_kitti_poses_alone_are_enough_until_a_scan_is_read(kitti):
    whole = positions(open_sequence(kitti))
    shutil.rmtree(kitti / 'sequences/08/velodyne')
    alone = open_sequence(kitti)
    np.testing.assert_array_equal(positions(alone), whole)
    with pytest.raises(GclError, match=r'no folder .*08/velodyne; KITTI odometry is laid out'):
        alone.scan(0)


def test_kitti_root_with_several_sequences_asks_which(kitti):
    shutil.copytree(kitti / 'sequences/08', kitti / 'sequences/09')
    with pytest.raises(GclError, match='name one of 08, 09'):
        open_sequence(kitti)
    with pytest.raises(GclError, match=r'no folder .*sequences/11'):
        open_sequence(kitti, '11')


# nuScenes


def test_nuscenes_scans_and_poses_have_kittis_axes(nuscenes, scans, poses):
    (sequence,) = read_logs(nuscenes).values()
    assert sequence.name == 'nuscenes/n015-2018'
    assert len(sequence) == 3
    for i in range(3):
        np.testing.assert_allclose(sequence.scan(i).points, scans[i].points, atol=1e-4)
        close(sequence.T_world_lidar(i), poses[i])
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


@pytest.mark.parametrize(
    ('translation', 'message'),
    [
        ([10**400, 0, 0], "row 'e0' is no pose: int too large"),
        ([0, 0], "row 'e0' is no pose"),
        ([float('inf'), 0, 0], "row 'e0' is no finite pose"),
    ],
)
def test_broken_nuscenes_poses_are_named(nuscenes, translation, message):
    path = nuscenes / 'v1.0-mini/ego_pose.json'
    rows = json.loads(path.read_text())
    for row in rows:
        row['translation'] = translation
    path.write_text(json.dumps(rows))
    with pytest.raises(GclError, match=message):
        read_logs(nuscenes)


def test_a_nuscenes_cloud_is_read_as_one(nuscenes):
    """Twenty bytes a point, and a number of points whose bytes KITTI's sixteen divide too."""
    path = nuscenes / 'samples/LIDAR_TOP/log__0.pcd.bin'
    rows = np.arange(40, dtype=np.float32).reshape(8, 5)
    rows.tofile(path)
    assert np.array_equal(read_cloud(path).points, rows[:, :3])


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
    with pytest.raises(GclError, match=r'versions v1\.0-mini, v1\.0-trainval; name the folder'):
        read_logs(nuscenes)
    assert len(open_sequence(nuscenes / 'v1.0-mini')) == 3
    assert sequence_names(nuscenes / 'v1.0-mini') == ['n015-2018']
    with pytest.raises(GclError, match=r'no .*v1\.0-\*/sample_data'):
        read_logs(tmp_path_factory.mktemp('empty'))


# ETH


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
    (eth / 'gt.log').write_text(''.join(log.splitlines(keepends=True)[:5]))
    with pytest.raises(GclError, match='does not link cloud 2'):
        EthSequence(eth).T_world_lidar(2)
    for content, message in [
        ('\n'.join(log.splitlines()[:8]), r'entry 1: expected a 4x4 matrix, got \(2, 4\)'),
        ('0 1 3\n1 2\n', 'expected a 4x4 matrix'),
        (log.replace('2\t1\t3', '0\t7\t3'), 'links 0 and 7, but there are 3 clouds'),
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
    np.savetxt(folder / 'poses.txt', [poses[i][:3].ravel() for i in order])
    sequence = open_sequence(folder)
    close(sequence.T_world_lidar(1), poses[2])


def test_broken_folders_are_named(tmp_path):
    with pytest.raises(GclError, match='no cloud in'):
        FolderSequence(tmp_path)
    with pytest.raises(GclError, match='cannot list'):
        FolderSequence(tmp_path / 'none')
    cloud = PointCloud(np.ones((3, 3), np.float32))
    write_cloud(tmp_path / 'a.npy', cloud)
    np.savetxt(tmp_path / 'poses.txt', [np.eye(4)[:3].ravel()] * 2)
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
