"""Every estimator on matches that are mostly wrong, too few, or degenerate."""

import importlib.util

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.estimators import EstimatorConfig, estimate
from gcl_core.estimation.open3d_ransac import Open3dRansacConfig
from gcl_core.estimation.ransac import RansacConfig
from gcl_core.estimation.spatial_consistency import SpatialConsistencyConfig
from gcl_core.evaluation import metrics
from gcl_core.types import Correspondences

OPEN3D = Open3dRansacConfig(threshold=0.5, samples=100_000, confidence=0.999)
ALL = {
    'ransac': EstimatorConfig(),
    'ransac_rigid': EstimatorConfig(ransac=RansacConfig(model='rigid')),
    'spatial_consistency': EstimatorConfig(name='spatial_consistency'),
    'open3d_ransac': EstimatorConfig(name='open3d_ransac', open3d_ransac=OPEN3D),
}
if importlib.util.find_spec('kiss_matcher'):
    ALL['kiss_matcher'] = EstimatorConfig(name='kiss_matcher')
OURS = ('ransac', 'spatial_consistency')
each = pytest.mark.parametrize('config', ALL.values(), ids=ALL.keys())
T_TRUE = se3.from_xyz_rpy(x=28.0, y=-6.0, z=0.4, roll=0.01, pitch=-0.02, yaw=0.6)


def matches(share_of_outliers, *, count=800, seed=0, noise=0.1, shape=(40, 40, 4), T=T_TRUE):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (count, 3)) * shape
    target = se3.transform(T, source) + rng.normal(size=source.shape) * noise
    wrong = round(share_of_outliers * count)
    target[:wrong] = se3.transform(T, rng.uniform(-1, 1, (wrong, 3)) * shape)
    order = rng.permutation(count)
    weight = torch.from_numpy(rng.uniform(0.5, 1.0, count)).float()
    source, target = (torch.from_numpy(a[order]).float() for a in (source, target))
    return Correspondences(source, target, weight)


def right(hypotheses, T=T_TRUE):
    best = hypotheses[0].T_target_source.numpy()
    return metrics.registered(best, T, metrics.STRICT)


@each
@pytest.mark.parametrize('outliers', [0.0, 0.5, 0.8])
def test_finds_the_transform(config, outliers):
    assert right(estimate(matches(outliers), config))


@pytest.mark.parametrize('name', OURS)
@pytest.mark.parametrize('outliers', [0.9, 0.95, 0.98])
@pytest.mark.parametrize('seed', [0, 1])
def test_ours_bear_nearly_all_wrong(name, outliers, seed):
    found = estimate(matches(outliers, count=2000, seed=seed), EstimatorConfig(name=name))
    assert right(found)


@each
@pytest.mark.parametrize('count', [0, 1, 2])
def test_too_few_matches_find_nothing_false(config, count):
    c = matches(0.0, count=count, noise=0.0)
    for h in estimate(c, config):  # two points do give a level transform
        assert h.inliers <= count
        assert torch.isfinite(h.T_target_source).all()
    assert count >= 2 or estimate(c, config) == []


@each
def test_not_finite_matches_change_nothing(config):
    c = matches(0.5)
    bad = torch.full((20, 3), torch.nan)
    more = Correspondences(
        torch.cat([bad, c.source]),
        torch.cat([c.target[:20], c.target]),
        torch.cat([c.weight[:20], c.weight]),
    )
    assert right(estimate(more, config))


@each
@pytest.mark.parametrize('shape', [(40, 0, 0), (40, 40, 0)], ids=['collinear', 'coplanar'])
def test_degenerate_matches_give_rigid_transforms_or_none(config, shape):
    for h in estimate(matches(0.3, shape=shape, noise=0.02), config):
        rotation = h.T_target_source[:3, :3]
        square = rotation @ rotation.t()
        torch.testing.assert_close(square, torch.eye(3).double(), atol=1e-4, rtol=0)
        assert torch.linalg.det(rotation) > 0


@each
def test_coplanar_matches_are_enough(config):
    assert right(estimate(matches(0.3, shape=(40, 40, 0), noise=0.02), config))


@each
def test_duplicates_do_not_disturb(config):
    c = matches(0.6)
    rows = torch.cat([torch.arange(len(c)), torch.zeros(200, dtype=torch.long)])
    assert right(estimate(Correspondences(c.source[rows], c.target[rows], c.weight[rows]), config))


@each
def test_one_point_matched_to_all_is_no_place(config):
    c = matches(0.0, count=100)
    same = Correspondences(c.source[:1].expand(100, 3), c.target, c.weight)
    for h in estimate(same, config):
        assert h.inliers < 50


@pytest.mark.parametrize('name', OURS)
def test_same_matches_same_bits(name):
    first, second = (estimate(matches(0.9), EstimatorConfig(name=name)) for _ in range(2))
    assert len(first) == len(second)
    for a, b in zip(first, second):
        assert torch.equal(a.T_target_source, b.T_target_source)


@pytest.mark.parametrize('name', OURS)
def test_two_places_come_as_two_hypotheses_best_first(name):
    T_other = se3.from_xyz_rpy(x=-15.0, y=8.0, yaw=-0.9)
    a, b = matches(0.6, count=500), matches(0.6, count=350, seed=1, T=T_other)
    both = Correspondences(
        torch.cat([a.source, b.source]),
        torch.cat([a.target, b.target]),
        torch.ones(850),
    )
    found = estimate(both, EstimatorConfig(name=name))
    assert right(found)
    assert right(found[1:], T_other)
    assert found[0].score >= found[1].score


@each
def test_heading_limit_is_kept(config):
    for h in estimate(matches(0.5), config, max_yaw=0.3):
        assert abs(se3.yaw(h.T_target_source.numpy())) <= 0.3


def test_missing_package_is_named():
    if importlib.util.find_spec('kiss_matcher'):
        pytest.skip('kiss-matcher is installed')
    with pytest.raises(GclError, match='pip install kiss-matcher'):
        estimate(matches(0.5), EstimatorConfig(name='kiss_matcher'))


def test_bad_settings_are_named():
    with pytest.raises(GclError, match='members 3'):
        SpatialConsistencyConfig(members=2)
    with pytest.raises(GclError, match=r'ransac\.keep'):
        RansacConfig(keep=0)
