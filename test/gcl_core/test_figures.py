"""The analysis figures on a corridor of a few thousand points, and by their command."""

import json
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.evaluation import peers
from gcl_core.evaluation.benchmark import BenchmarkConfig, Ours
from gcl_core.evaluation.figures import (
    OF_FEATURES,
    OF_POSITIVES,
    compare,
    compared,
    correlation,
    drift,
    inliers,
    positives,
)
from gcl_core.evaluation.figures.__main__ import main
from gcl_core.evaluation.figures.dependence import near_curve, roadside, shared_bits
from gcl_core.evaluation.figures.sampling import densest, draw_positives, two_members
from gcl_core.evaluation.neighborhood import Neighborhood, centres, neighborhood, neighborhoods
from gcl_core.evaluation.report import gather
from gcl_core.models import zoo
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.registrar import Registrar
from gcl_core.types import Features, PointCloud


class Corridor:
    """Two walls and a road; a scan every 5 m sees each point with odds that fall with distance."""

    def __init__(self, length: float = 130.0, seed: int = 0) -> None:
        self.name = f'corridor/{seed}'
        rng = np.random.default_rng(seed)
        along = rng.uniform(-40, length + 40, 6_000)
        side = rng.choice([-9.0, 7.0], 6_000) + 0.8 * np.sin(along / 3)
        walls = np.stack([along, side, rng.uniform(-1.7, 3, 6_000)], 1)
        road = np.stack([along, side * rng.uniform(-1, 1, 6_000), np.full(6_000, -1.7)], 1)
        self._points = np.concatenate([walls, road])
        self._x = np.arange(0, length, 5.0)

    def __len__(self) -> int:
        return len(self._x)

    def T_world_lidar(self, index: int) -> np.ndarray:
        return se3.from_xyz_rpy(x=float(self._x[index]), yaw=0.02 * index)

    @lru_cache  # noqa: B019
    def scan(self, index: int) -> PointCloud:
        points = se3.transform(se3.inverse(self.T_world_lidar(index)), self._points)
        rng = np.random.default_rng(index)
        away = np.linalg.norm(points, axis=1)
        seen = rng.random(len(points)) < np.minimum(1, (12 / away) ** 2)
        return PointCloud(points[seen & (away < 60)].astype(np.float32))


@pytest.fixture(scope='module')
def corridor():
    return Corridor()


@pytest.fixture(scope='module')
def registrar():
    return Registrar()


def test_equation_2_holds_on_the_curve():
    b, h = 30.0, 8.0
    x, y = np.sqrt(np.maximum(roadside(b, h) ** 2 - h**2, 0)).T
    residual = np.minimum(abs(abs(x + y) - b), abs(abs(x - y) - b))
    np.testing.assert_allclose(residual, 0, atol=1e-6)


def test_points_of_a_roadside_line_are_on_the_curve_and_others_are_not():
    along = np.random.default_rng(0).uniform(-40, 60, 500)
    line = np.stack([along, np.full(500, 6.0), np.zeros(500)], 1)
    ranges = np.stack([np.linalg.norm(line - [x, 0, 0], axis=1) for x in (0, 25)], 1)
    assert near_curve(ranges, 25.0, 6.0, 0.3) == 1.0
    assert near_curve(ranges + [0, 5.0], 25.0, 6.0, 0.3) < 0.2


def test_shared_bits_of_independent_and_of_equal_ranges():
    rng = np.random.default_rng(0)
    ranges = rng.uniform(0, 80, (20_000, 2))
    assert shared_bits(ranges, rng) == pytest.approx(0, abs=0.01)
    assert shared_bits(ranges[:, [0, 0]], rng) == pytest.approx(4, abs=0.05)  # 16 cells


def test_centres_are_where_most_segments_are_filled(corridor):
    assert centres(corridor, 3) == sorted(set(centres(corridor, 3)))
    assert all(40 < 5.0 * i < 90 for i in centres(corridor, 3))
    assert len(centres(corridor, 100)) < len(corridor)
    with pytest.raises(GclError, match='no scan within 60 m'):
        neighborhood(Corridor(5.0), 0, np.random.default_rng(0))


def test_positives_are_pairs_of_the_partner_and_groups_of_all(corridor):
    (taken,) = draw_positives({'a': corridor}, 1, seed=0, apart=40.0)
    assert abs(taken.b - 40) <= 20
    assert set(taken.pairs.sizes.tolist()) == {2}
    assert len(taken.groups) > len(taken.pairs)
    assert 1.0 < taken.h < 10.0
    members = two_members(taken.groups, np.random.default_rng(0))
    pairs = taken.groups.sizes == 2
    own = taken.groups.sensor_range[torch.repeat_interleave(pairs, taken.groups.sizes)]
    np.testing.assert_allclose(
        np.sort(members[pairs.numpy()], axis=1), np.sort(own.view(-1, 2).numpy(), axis=1)
    )


def test_the_densest_observation_is_not_always_the_nearest():
    spot = np.array([10.0, 0, 0])
    near, far = spot + [[0, 0, 0]], spot + [20, 0, 0] + np.random.default_rng(0).random((5, 3)) / 9
    clouds = tuple(PointCloud(points.astype(np.float32)) for points in (near, far))
    points = tuple(torch.from_numpy(c.points).mean(0, keepdim=True) for c in clouds)
    poses = np.stack([np.eye(4), se3.from_xyz_rpy(x=-20)])
    place = Neighborhood('a', (0, 1), clouds, points, poses)
    groups = place.groups()
    assert groups.member[groups.finest].tolist() == [0]
    assert groups.member[densest(place, groups).finest].tolist() == [1]
    alike = replace(place, clouds=(clouds[0], PointCloud(points[1].numpy())))
    assert groups.member[densest(alike, groups).finest].tolist() == [0]


def test_features_that_name_their_spot_do_not_drift(corridor):
    """Descriptors of the world position drift little, those of the sensor's own frame more."""
    places = list(neighborhoods({'a': corridor}, 1, seed=0))
    groups = [place.groups() for place in places]
    clouds, poses = places[0].clouds, places[0].T_centre_scan

    def where(cloud, T):
        points = torch.from_numpy(cloud.points)
        moved = torch.from_numpy(se3.transform(T, cloud.points)) / 20
        return Features(points, torch.cat([moved.sin(), moved.cos()], 1) / 3**0.5)

    spots = drift.measure(places, groups, [list(map(where, clouds, poses))], 0)
    sensors = drift.measure(places, groups, [[where(c, np.eye(4)) for c in clouds]], 0)
    assert np.median(spots.drift) < 0.05 * spots.unrelated
    assert np.median(sensors.drift) > 0.5 * sensors.unrelated


def figure(name, registrar, sequences, seed):
    if name in OF_POSITIVES:
        return OF_POSITIVES[name](sequences, seed=seed)
    return OF_FEATURES[name](compare({'ours': registrar}, sequences, seed=seed))


@pytest.fixture(scope='module')
def drawn(corridor, registrar):
    """Each figure, drawn once, from few scans."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (compared, positives):
            patch.setattr(module, 'CENTRES', 1)
        patch.setattr(correlation, 'BATCHES', 1)
        patch.setattr(inliers, 'PER_BIN', 1)
        yield lru_cache(lambda name, run: figure(name, registrar, {'a': corridor}, seed=1))


@pytest.mark.parametrize('name', [*OF_POSITIVES, *OF_FEATURES])
def test_a_figure_says_what_it_draws_and_is_the_same_again(name, drawn):
    found = drawn(name, 1)
    assert found.name == name
    assert 'corridor/0' in found.caption
    assert found.published.startswith(('Section', 'Figure', 'Appendix'))
    assert ElementTree.fromstring(found.svg).tag.endswith('svg')
    assert ' m</text>' in found.svg
    assert json.loads(json.dumps(found.rows)) == found.rows
    assert found == drawn(name, 2)


def test_pairs_depend_on_range_more_than_groups(drawn):
    bits = {'pair-wise': [], 'group-wise': []}
    for row in drawn('correlation', 1).rows:
        bits[row['kind']].append(row['bits'])
    assert min(bits['pair-wise']) > max(bits['group-wise'])


def test_positives_are_points_of_the_centre_and_groups_have_more(drawn):
    rows = drawn('positives', 1).rows
    assert all(r['pair-wise'] <= r['group-wise'] <= r['points'] for r in rows)
    assert sum(r['pair-wise'] for r in rows) < sum(r['group-wise'] for r in rows)


@pytest.mark.parametrize('name', ['correlation', 'drift', 'positives'])
def test_poses_that_do_not_fit_are_told(name, registrar, monkeypatch):
    tower = Corridor(40.0)
    where = Corridor.T_world_lidar
    monkeypatch.setattr(
        tower, 'T_world_lidar', lambda i: se3.from_xyz_rpy(z=8.0 * i) @ where(tower, i)
    )
    monkeypatch.setattr(tower, 'scan', Corridor(40.0).scan)
    with pytest.raises(
        GclError, match=r'no neighbour sees a point of scan . of corridor/0; check'
    ):
        figure(name, registrar, {'a': tower}, seed=0)


def test_a_benchmark_draws_positives_once_for_all_methods(corridor, monkeypatch):
    monkeypatch.setattr(positives, 'CENTRES', 1)
    methods = (Ours(), Ours(name='other'))
    config = BenchmarkConfig(pairs=(), methods=methods, figures=('positives',))
    run = SimpleNamespace(config=config, sequences={'a': corridor}, drawn=[], provenance={})
    results = gather(run, [])
    assert [(f['name'], f['method']) for f in results.figures] == [('positives', '')]
    assert [table.title for table in results.tables] == ['Figure positives']
    assert len(results.drawings) == 1


class Mounted:
    """A drive as a sensor turned by 35 degrees on its vehicle records it."""

    T_turned_lidar = se3.from_xyz_rpy(yaw=np.deg2rad(35))

    def __init__(self, drive):
        self._drive, self.name = drive, 'mounted'

    def __len__(self):
        return len(self._drive)

    def T_world_lidar(self, index):
        return self._drive.T_world_lidar(index) @ se3.inverse(self.T_turned_lidar)

    def scan(self, index):
        return PointCloud(se3.transform(self.T_turned_lidar, self._drive.scan(index).points))


def test_inliers_do_not_depend_on_how_the_sensor_is_mounted(drive, registrar, monkeypatch):
    """Weights that bear 16 degrees are given scans that were turned to their street."""
    monkeypatch.setattr(compared, 'CENTRES', 1)

    def ratios(sequence):
        found = OF_FEATURES['inliers'](compare({'ours': registrar}, {'a': sequence}))
        return [row['inlier_ratio'] for row in found.rows if row['method'] == 'ours']

    np.testing.assert_allclose(ratios(Mounted(drive)), ratios(drive), atol=0.05)


def test_a_benchmark_describes_every_scan_once_and_draws_all_methods_in_one(monkeypatch):
    monkeypatch.setattr(compared, 'CENTRES', 1)
    monkeypatch.setattr(inliers, 'PER_BIN', 1)
    described = []
    fpfh = lambda cloud: described.append(cloud) or peers.fpfh_features(cloud)  # noqa: E731
    monkeypatch.setattr(compared, 'fpfh_features', fpfh)
    methods, figures = (Ours(), Ours(name='other')), ('drift', 'inliers')
    config = BenchmarkConfig(pairs=(), methods=methods, figures=figures)
    sequences = {'a': Corridor(40.0)}
    run = SimpleNamespace(config=config, sequences=sequences, drawn=[], provenance={})
    results = gather(run, [])
    assert len(described) == len({id(cloud) for cloud in described}) > 2
    assert [f['name'] for f in results.figures] == ['drift', 'inliers']
    for found in results.figures:
        assert {row['method'] for row in found['rows']} == {'GCL-ROS', 'other', 'FPFH'}


def test_a_command_draws_one(tmp_path, capsys, monkeypatch, write_folder):
    monkeypatch.setattr(compared, 'CENTRES', 1)
    torch.manual_seed(0)
    tiny = ResUNetConfig(encoder=(4, 6, 8, 8), decoder=(8, 8, 8), head=8, descriptor=8)
    zoo.save_weights(tmp_path / 'pairs.safetensors', zoo.build(tiny), {})
    clouds, out = tmp_path / 'clouds', tmp_path / 'drift.svg'
    corridor = Corridor(40.0)
    write_folder(clouds, corridor, range(len(corridor)))
    arguments = ['drift', '--data', str(clouds), '--out', str(out)]
    main([*arguments, '--baseline', str(tmp_path / 'pairs.safetensors')])
    rows = json.loads(out.with_suffix('.json').read_text())['rows']
    assert {row['method'] for row in rows} == {'GCL-ROS', 'FPFH', 'pair-wise'}
    assert 'feature drift' in out.read_text()
    assert 'published' in capsys.readouterr().out
    for bad in (
        ['positives', *arguments[1:], '--baseline', 'x'],
        [*arguments[:-1], str(out / 'x.svg')],
    ):
        with pytest.raises(SystemExit, match='2'):
            main(bad)
    assert 'cannot write' in capsys.readouterr().err
