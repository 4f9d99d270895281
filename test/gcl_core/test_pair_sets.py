"""Rules of the pair sets as properties, their sizes on KITTI's poses, and lists in files."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcl_core import se3
from gcl_core.data import pair_sets
from gcl_core.data.distance_pairs import DistanceRule, dense_rule, distance_pairs, fcgf_pairs
from gcl_core.data.kitti import lidar_poses
from gcl_core.data.overlap import overlap
from gcl_core.data.pair_list import PairList, bin_of, listed, read_pair_list, write_pair_list
from gcl_core.data.sequence import positions
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

TEST_SPLIT = ('08', '09', '10')


def walk(seed: int, count: int) -> np.ndarray:
    """Positions of a drive with bends and stops."""
    rng = np.random.default_rng(seed)
    speed = np.repeat(rng.choice([0.0, 0.5, 1.0, 2.0], count // 20 + 1), 20)[:count]
    heading = np.cumsum(rng.normal(size=count) * 0.03)
    steps = speed[:, None] * np.stack([np.cos(heading), np.sin(heading), 0 * heading], 1)
    return np.cumsum(steps, 0)


class Drive:
    """Poses without scans."""

    def __init__(self, name, where):
        self.name, self._where = name, where

    def __len__(self):
        return len(self._where)

    def T_world_lidar(self, index):
        return se3.from_rotation_translation(np.eye(3), self._where[index])


rules = st.sampled_from([(5, 10), (10, 20), (20, 30), (30, 40), (40, 50)]).flatmap(
    lambda b: st.sampled_from([DistanceRule(*b), dense_rule(*b)])
)


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 900), rule=rules)
def test_distance_pairs_keep_their_rules(seed, count, rule):
    where = walk(seed, count)
    pairs = distance_pairs(where, rule)
    assert pairs == distance_pairs(where, rule)
    previous = None
    for source, target in pairs:
        assert min(rule.start, count // 2) <= source < target < source + rule.window
        apart = np.linalg.norm(where[source : target + 2] - where[source], axis=1)
        assert apart[-1] > rule.low  # the next frame lies beyond the drawn distance …
        assert (apart[:-1] <= rule.high).all()  # … and no frame before it does
        for frame in (source, target):
            around = np.linalg.norm(where - where[frame], axis=1) > rule.surroundings
            assert around[max(0, frame - rule.window) : frame].any()
            assert around[frame : frame + rule.window].any()
        if previous is not None:
            first = previous[1] + 1 if rule.advance is None else previous[0] + rule.advance
            assert source >= first
        previous = (source, target)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), shift=st.floats(-1000, 1000))
def test_distance_pairs_do_not_depend_on_the_world(seed, shift):
    where = walk(seed, 600)
    turned = se3.transform(se3.from_xyz_rpy(x=shift, y=3.0, yaw=0.0), where)
    rule = DistanceRule(10, 20)
    assert distance_pairs(where, rule) == distance_pairs(turned, rule)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 500))
def test_fcgf_pairs_are_the_last_within_ten_metres(seed, count):
    where = walk(seed, count)
    pairs = fcgf_pairs(where)
    following = [source for source, _ in pairs[1:]] + [count]
    for (source, target), after in zip(pairs, following[: len(pairs)], strict=True):
        apart = np.linalg.norm(where[source : target + 2] - where[source], axis=1)
        assert (apart[:-1] <= 10).all()
        assert apart[-1] > 10
        assert after > target


def test_a_gap_gives_no_pair_of_a_scan_with_itself():
    where = np.zeros((400, 3))
    where[:, 0] = np.arange(400) * 50.0
    assert distance_pairs(where, DistanceRule(20, 30)) == []
    assert fcgf_pairs(where) == []


def test_bad_distances_are_named():
    with pytest.raises(GclError, match='distances 30 to 20 m'):
        DistanceRule(30, 20)


# KITTI's own poses


@pytest.fixture(scope='session')
def split(kitti_poses_root):
    """Drives of the test split, LiDAR poses without scans."""
    drives = {}
    for name in TEST_SPLIT:
        calibration = kitti_poses_root / f'sequences/{name}/calib.txt'
        poses = lidar_poses(kitti_poses_root / f'poses/{name}.txt', calibration)
        drives[name] = Drive(f'kitti/{name}', poses[:, :3, 3])
    return drives


SIZES = [(5, 10, 674), (10, 20, 341), (20, 30, 206), (30, 40, 144), (40, 50, 111)]


@pytest.mark.parametrize(('low', 'high', 'size'), SIZES)
def test_sizes_of_the_test_split(split, low, high, size):
    pairs = pair_sets.distance_set(split, low, high)
    assert len(pairs.pairs) == size
    assert pairs.name == f'kitti [{low},{high}]'


def test_fcgf_split_has_its_555_pairs(split):
    assert len(pair_sets.fcgf_set(split).pairs) == 555


def test_lokitti_candidates_hold_the_public_list(split, kitti_poses_root):
    """All 545 first scans come out, and 97 % of partners within one frame (SuMa poses)."""
    public = read_pair_list(kitti_poses_root / 'lokitti_pairs.txt')
    assert len(public.pairs) == 545
    assert public.sequences == TEST_SPLIT
    partners: dict[tuple[str, int], list[int]] = {}
    for name, drive in split.items():
        for low, high in ((20, 30), (30, 40), (40, 50)):
            for source, target in distance_pairs(positions(drive), dense_rule(low, high)):
                partners.setdefault((name, source), []).append(target)
    off = [min(abs(t - p.target) for t in partners[p.sequence, p.source]) for p in public.pairs]
    assert sum(d <= 1 for d in off) >= 531
    assert sum(d == 0 for d in off) >= 389


# Overlap


def test_overlap_by_hand():
    grid = np.arange(10) * 2.0
    points = np.stack([grid, 0 * grid, 0 * grid], 1).astype(np.float32)
    source, target = PointCloud(points), PointCloud(points[:4])
    share = overlap(source=source, target=target, T_target_source=np.eye(4))
    assert share == pytest.approx(0.4)
    assert overlap(source=target, target=source, T_target_source=np.eye(4)) == 1.0
    for offset, expected in ((0.44, 0.4), (0.46, 0.0)):
        T = se3.from_xyz_rpy(y=offset)
        share = overlap(source=source, target=target, T_target_source=T)
        assert share == pytest.approx(expected)


def test_overlap_counts_voxels_not_points():
    far = np.tile([[9.1, 0.1, 0.1]], (100, 1))
    source = PointCloud(np.vstack([[[0.1, 0.1, 0.1]], far]).astype(np.float32))
    target = PointCloud(np.array([[0.1, 0.1, 0.1]], np.float32))
    assert overlap(source=source, target=target, T_target_source=np.eye(4)) == pytest.approx(0.5)


class Field(Drive):
    """A field of posts of which a sensor sees those within 30 m."""

    posts = np.random.default_rng(0).uniform([-50, -15, 0], [450, 15, 3], (5000, 3))

    def scan(self, index):
        own = self.posts - self._where[index]
        return PointCloud(own[np.linalg.norm(own, axis=1) < 30].astype(np.float32))


@pytest.mark.parametrize('dense', [True, False])
def test_low_overlap_set_keeps_the_low_ones(dense):
    where = np.stack([np.arange(400.0), np.zeros(400), np.zeros(400)], 1)
    seen = {}
    pairs = pair_sets.low_overlap_set(
        {'a': Field('field/a', where)},
        dense=dense,
        keep=lambda pair, share: seen.update({pair: share}),
    )
    assert pairs.name == 'field low overlap'
    assert set(pairs.pairs) == {pair for pair, share in seen.items() if share <= 0.3}
    apart = {pair: pair.target - pair.source for pair in seen}
    assert 0 < len(pairs.pairs) < len(seen)
    # Two circles of 30 m share 30 % of either at about 35 m.
    for pair in seen:
        if abs(apart[pair] - 35) > 4:
            assert (apart[pair] > 35) == (pair in pairs.pairs)


# Lists


def sample() -> PairList:
    pairs = (*listed('08', [(150, 185), (186, 200)]), *listed('n015-2018', [(3, 9)]))
    return PairList('kitti [20,30]', pairs, (20, 30), ('rule: by hand', 'a note'))


def test_lists_survive_a_round_trip(tmp_path):
    write_pair_list(tmp_path / 'list.txt', sample())
    assert read_pair_list(tmp_path / 'list.txt') == sample()
    assert sample().sha256[:12] in sample().label


def test_the_hash_is_of_pairs_and_order(tmp_path):
    pairs = sample()
    assert PairList('other', pairs.pairs).sha256 == pairs.sha256
    assert PairList('other', pairs.pairs[::-1]).sha256 != pairs.sha256
    write_pair_list(tmp_path / 'list.txt', pairs)
    text = (tmp_path / 'list.txt').read_text()
    (tmp_path / 'list.txt').write_text(text.replace('150 185', '150 186'))
    with pytest.raises(GclError, match='they were changed'):
        read_pair_list(tmp_path / 'list.txt')


def test_public_lists_read(tmp_path):
    (tmp_path / 'lokitti.txt').write_text('# sequence frame_a frame_b: from elsewhere\n8 1 5\n')
    pairs = read_pair_list(tmp_path / 'lokitti.txt')
    assert pairs.pairs == listed('08', [(1, 5)])
    assert pairs.name == 'lokitti'


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        (None, 'cannot read pair list'),
        ('# only notes\n', 'lists no pair'),
        ('8 1\n', "line 1: expected `sequence source target`, got '8 1'"),
        ('8 1 x\n', 'line 1: expected'),
        ('8 1 -5\n', 'line 1: expected'),
        ('# distance_m: 20 metres\n8 1 5\n', 'expected two whole numbers'),
    ],
)
def test_broken_lists_are_named(tmp_path, content, message):
    if content is not None:
        (tmp_path / 'list.txt').write_text(content)
    with pytest.raises(GclError, match=message):
        read_pair_list(tmp_path / 'list.txt')


def test_lists_go_with_their_sequence():
    where = np.stack([np.arange(201.0), np.zeros(201), np.zeros(201)], 1)
    (first, second) = sample().of('08', Drive('kitti/08', where))
    assert (first.source, first.target, first.distance, first.bin) == (150, 185, 35.0, (20, 30))
    assert second.distance == 14.0
    with pytest.raises(GclError, match='lists scan 185 of 08, but kitti/08 has 100 scans'):
        sample().of('08', Drive('kitti/08', where[:100]))
    with pytest.raises(GclError, match='must be one word'):
        listed('my drive', [])


def test_bins_beyond_the_papers():
    assert [bin_of(d) for d in (7.0, 10.0, 49.9, 50.6, 3.0)] == [
        (5, 10), (10, 20), (40, 50), (50, 60), (0, 10)
    ]  # fmt: skip
