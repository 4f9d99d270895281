import numpy as np
import pytest

from gcl_core import se3
from gcl_core.data.group_index import GroupIndex, find_centres
from gcl_core.data.groups import draw_neighbors, segments
from gcl_core.data.sequence import positions
from gcl_core.errors import GclError


def straight(count):
    return np.stack([np.arange(float(count)), np.zeros(count), np.zeros(count)], 1)


def test_centres_are_eleven_frames_apart_with_all_segments_filled():
    assert find_centres(straight(200), phi=6) == list(range(41, 159, 11))
    assert find_centres(straight(80), phi=6) == []
    assert find_centres(straight(80), phi=2, every=1) == list(range(1, 79))


def test_later_visits_of_a_place_are_no_neighbours():
    there = straight(100)
    where = np.vstack([there, there + [0, 500, 0], there])
    assert all((part < 100).all() for part in segments(where, 50, 6, window=100))
    assert any((part >= 200).any() for part in segments(where, 50, 6))


def test_segments_partition_the_scans_within_reach():
    where = straight(300)
    parts = segments(where, 150, 6)
    assert sorted(np.concatenate(parts)) == [i for i in range(90, 210) if i != 150]
    drawn = draw_neighbors(where, 150, 6, np.random.default_rng(0))
    assert all(scan in part for scan, part in zip(drawn, parts, strict=True))


def test_an_epoch_visits_every_centre_once_and_draws_anew(drive):
    index = GroupIndex([drive], phi=4)
    count = len(index)
    assert count >= 2
    epochs = [[index.scans(e * count + i, seed=0)[1] for i in range(count)] for e in (0, 1)]
    expected = sorted(centre for _, centre in index.centres)
    for epoch in epochs:
        assert sorted(scans[0] for scans in epoch) == expected
        assert all(len(set(scans)) == 5 for scans in epoch)
    assert sorted(epochs[0]) != sorted(epochs[1])
    again = GroupIndex([drive], phi=4)
    assert [again.scans(i, seed=0)[1] for i in range(count)] == epochs[0]
    assert [again.scans(i, seed=1)[1] for i in range(count)] != epochs[0]


def test_a_group_holds_clouds_and_their_poses_in_the_centres_frame(drive):
    index = GroupIndex([drive, drive], phi=2)
    assert {number for number, _ in index.centres} == {0, 1}
    group = index.group(1, seed=0)
    assert group.sequence == 'sim/3'
    np.testing.assert_allclose(group.T_centre_scan[0], np.eye(4), atol=1e-9)
    for cloud, T, scan in zip(group.clouds, group.T_centre_scan, group.scans, strict=True):
        np.testing.assert_array_equal(cloud.points, drive.scan(scan).points)
        expected = se3.inverse(drive.T_world_lidar(group.scans[0])) @ drive.T_world_lidar(scan)
        np.testing.assert_allclose(T, expected)
    along = positions(drive)
    apart = [np.linalg.norm(along[s] - along[group.scans[0]]) for s in group.scans[1:]]
    assert max(apart) < 60


def test_drives_that_are_too_short_are_named(drive):
    with pytest.raises(GclError, match='no scan of sim/3 has a neighbour in each of 40 segments'):
        GroupIndex([drive], phi=40, window=10)
    with pytest.raises(GclError, match='no scan of no sequence'):
        GroupIndex([])
