import json

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.data.pair_list import read_pair_list
from gcl_core.errors import GclError
from gcl_core.types import PointCloud
from gcl_ros.bag import (
    SOURCE,
    TARGET,
    TRUTH,
    Encounter,
    following,
    pair_encounters,
    pair_list_label,
    read_encounters,
    write_bag,
)
from gcl_ros.bag_reader import open_bag
from gcl_ros.conversions import matrix, point_cloud, seconds


@pytest.fixture
def encounter() -> Encounter:
    points = np.random.default_rng(0).normal(size=(100, 3)).astype(np.float32)
    return Encounter(7.5, PointCloud(points), PointCloud(points + 1), se3.from_xyz_rpy(9, yaw=1))


def read(path):
    with open_bag(path) as bag:
        return [(c.topic, message) for c, _, message in bag.messages(bag.connections)]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_bag_round_trip(tmp_path, encounter, storage):
    assert write_bag(tmp_path / 'bag', [encounter], storage) == 1
    messages = dict(read(tmp_path / 'bag'))
    truth = messages[TRUTH]
    np.testing.assert_allclose(matrix(truth.transform), encounter.T_target_source, atol=1e-12)
    assert truth.header.frame_id == messages[TARGET].header.frame_id == 'target/lidar'
    assert truth.child_frame_id == messages[SOURCE].header.frame_id == 'source/lidar'
    for topic, cloud in ((SOURCE, encounter.source), (TARGET, encounter.target)):
        np.testing.assert_array_equal(point_cloud(messages[topic]).points, cloud.points)
        assert seconds(messages[topic].header.stamp) == 7.5


def test_encounters_are_read_back(tmp_path, encounter):
    write_bag(tmp_path / 'bag', [encounter])
    (back,) = read_encounters(tmp_path / 'bag')
    np.testing.assert_array_equal(back.source.points, encounter.source.points)
    np.testing.assert_allclose(back.T_target_source, encounter.T_target_source, atol=1e-12)
    assert back.stamp == 7.5


def test_random_yaw_turns_clouds_and_truth(drive):
    straight, turned = (
        next(pair_encounters(drive, drive, [(96, 90)], 1.0, random_yaw_seed=seed))
        for seed in (None, 4)
    )
    assert not np.allclose(straight.T_target_source, turned.T_target_source, atol=0.1)
    for e in (straight, turned):
        world = se3.transform(e.T_target_source, e.source.points.astype(float))
        np.testing.assert_allclose(
            world,
            se3.transform(straight.T_target_source, straight.source.points.astype(float)),
            atol=1e-3,
        )


def test_existing_and_missing_bags_are_named(tmp_path, encounter):
    with pytest.raises(GclError, match='exists already'):
        write_bag(tmp_path, [encounter])
    with pytest.raises(GclError, match='cannot read bag'), open_bag(tmp_path / 'none'):
        pass


def test_following_keeps_the_distance(drive):
    pairs = following(drive, 25.0)
    for source, target in pairs[::20]:
        T = se3.inverse(drive.T_world_lidar(target)) @ drive.T_world_lidar(source)
        assert 25.0 <= np.linalg.norm(T[:3, 3]) < 26.5
    with pytest.raises(GclError, match='900 m apart'):
        following(drive, 900.0)


def test_bag_from_real_kitti_layout(tmp_path, real_root, capsys):
    arguments = ['bag', 'from-kitti', str(real_root), '80', str(tmp_path / 'b')]
    assert main([*arguments, '--distance', '20', '--every', '20']) == 0
    messages = read(tmp_path / 'b')
    assert {topic for topic, _ in messages} == {SOURCE, TARGET, TRUTH}
    assert f'wrote {len(messages) // 3} pairs' in capsys.readouterr().out


def test_bag_from_simulator_pairs(tmp_path):
    arguments = ['bag', 'from-simulator', '3', str(tmp_path / 'b'), '--pairs', '1']
    assert main([*arguments, '--every', '5', '--storage', 'sqlite3']) == 0
    assert len(read(tmp_path / 'b')) == 3


def test_bag_from_a_folder_names_its_pairs(tmp_path, drive, capsys, write_folder):
    write_folder(tmp_path / 'scans', drive, (90, 97))
    arguments = ['bag', 'from-data', str(tmp_path / 'scans'), str(tmp_path / 'b')]
    assert main([*arguments, '--distance', '6']) == 0
    (encounter,) = read_encounters(tmp_path / 'b')
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(97)
    np.testing.assert_allclose(encounter.T_target_source, T, atol=1e-9)
    assert pair_list_label(tmp_path / 'b').startswith('folder/scans following at 6 m, 1 pairs')
    listing = tmp_path / 'l.txt'
    assert main(['pairs', str(listing), '--data', str(tmp_path / 'scans'), '--random', '1']) == 0
    arguments = ['bag', 'from-data', str(tmp_path / 'scans'), str(tmp_path / 'c')]
    assert main([*arguments, '--list', str(listing)]) == 0
    assert pair_list_label(tmp_path / 'c') == read_pair_list(listing).label
    listing.write_text('other 0 1\n')
    arguments[-1] = str(tmp_path / 'd')
    assert main([*arguments, '--list', str(listing)]) == 2
    assert 'lists no pair of scans' in capsys.readouterr().err


def test_info_tells_topics_pairs_and_distances(tmp_path, encounter, capsys):
    write_bag(tmp_path / 'b', [encounter], pair_list='one pair')
    assert main(['bag', 'info', str(tmp_path / 'b')]) == 0
    out = capsys.readouterr().out
    assert '3 messages' in out
    assert "/source/points  sensor_msgs/msg/PointCloud2  1 messages, frame 'source/lidar'" in out
    assert '100 points' in out
    assert 'pairs: one pair' in out
    assert '5–10 m: 1 pairs, headings up to 57° apart' in out
    assert main(['bag', 'info', str(tmp_path / 'b'), '--json']) == 0
    info = json.loads(capsys.readouterr().out)
    assert (info['messages'], info['pair_list']) == (3, 'one pair')
    assert [topic['points'] for topic in info['topics']] == [100, 100, None]
    assert 5 <= info['pairs'][0][0] < 10
    assert main(['bag', 'info', str(tmp_path / 'none')]) == 2


def test_from_folder_and_from_nuscenes_name_their_layout(tmp_path, drive, capsys, write_folder):
    (tmp_path / 'scans').mkdir()
    arguments = [str(tmp_path / 'scans'), str(tmp_path / 'b'), '--distance', '5']
    assert main(['bag', 'from-nuscenes', *arguments]) == 2
    assert 'v1.0' in capsys.readouterr().err
    write_folder(tmp_path / 'scans', drive, (90, 97))
    assert main(['bag', 'from-folder', *arguments]) == 0
    assert 'wrote 1 pairs' in capsys.readouterr().out
