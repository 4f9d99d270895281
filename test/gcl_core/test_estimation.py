import math

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation import hypothesis
from gcl_core.estimation.hypothesis import (
    DISTINCT_DISTANCE,
    LEAST_TRACE,
    distinct,
    distinct_best,
)
from gcl_core.estimation.procrustes import from_moments, products
from gcl_core.estimation.ransac import RansacConfig, ransac
from gcl_core.estimation.refine import RefineConfig, Refined, prepare, refine, refine_all
from gcl_core.evaluation import metrics
from gcl_core.ops.native.distinct import distinct_rows
from gcl_core.types import Correspondences


def correspondences(T, inliers, outliers):
    rng = np.random.default_rng(0)
    source = rng.uniform([-40, -40, -2], [40, 40, 5], (inliers + outliers, 3))
    target = se3.transform(T, source) + rng.normal(size=source.shape) * 0.1
    target[inliers:] = rng.uniform([-40, -40, -2], [40, 40, 5], (outliers, 3))
    order = rng.permutation(len(source))
    weight = torch.ones(len(source))
    return Correspondences(
        torch.from_numpy(source[order]).float(), torch.from_numpy(target[order]).float(), weight
    )


def test_least_squares_recovers_and_never_mirrors():
    T = se3.from_xyz_rpy(3, -2, 1, 0.2, -0.4, 2.5)
    flat = torch.rand(20, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([9, 9, 0])
    target = torch.from_numpy(se3.transform(T, flat.double().numpy()))
    found = from_moments(products(flat.double(), target).sum(0, keepdim=True))[0]
    np.testing.assert_allclose(found.numpy(), T, atol=1e-6)


@pytest.mark.parametrize('yaw', [0.0, 1.0, math.pi])
def test_level_ransac_finds_one_inlier_in_fifty(yaw):
    T = se3.from_xyz_rpy(x=35.0, y=4.0, z=0.4, roll=0.02, pitch=-0.02, yaw=yaw)
    found, runner_up = ransac(correspondences(T, 30, 1470), RansacConfig())[:2]
    assert runner_up.inliers < found.inliers / 2
    assert metrics.registered(found.T_target_source.numpy(), T, metrics.STRICT)
    assert 25 <= found.inliers <= 60


def test_rigid_ransac_finds_any_rotation():
    T = se3.from_xyz_rpy(x=5.0, y=-3.0, z=2.0, roll=1.0, pitch=-0.5, yaw=2.0)
    found = ransac(correspondences(T, 60, 540), RansacConfig(model='rigid'))[0]
    assert metrics.registered(found.T_target_source.numpy(), T, metrics.STRICT)


def test_same_seed_same_transform():
    c = correspondences(se3.from_xyz_rpy(x=20.0), 20, 500)
    first, second = (ransac(c, RansacConfig(seed=4))[0].T_target_source for _ in range(2))
    assert torch.equal(first, second)


def test_ransac_need_not_stop_early():
    T = se3.from_xyz_rpy(x=20.0)
    config = RansacConfig(samples=5_000, confidence=1.0)
    found = ransac(correspondences(T, 300, 100), config)[0]
    assert metrics.registered(found.T_target_source.numpy(), T, metrics.STRICT)


def test_heading_limit_is_kept():
    c = correspondences(se3.from_xyz_rpy(x=20.0, yaw=2.0), 50, 200)
    found = ransac(c, RansacConfig(), max_yaw=0.5)
    assert all(abs(se3.yaw(h.T_target_source.numpy())) < 0.6 for h in found)


@pytest.mark.parametrize('count', [0, 1])
def test_too_few_correspondences_find_nothing(count):
    assert ransac(correspondences(np.eye(4), count, 0), RansacConfig()) == []


def test_bad_settings_are_named():
    with pytest.raises(GclError, match='threshold is -1'):
        RansacConfig(threshold=-1)
    with pytest.raises(GclError, match='confidence is 2'):
        RansacConfig(confidence=2)


@pytest.mark.parametrize('limit', [3, 40, 1000])
def test_distinct_places_are_those_of_a_search_one_by_one(limit):
    rng = np.random.default_rng(0)
    where = rng.uniform([-20, -20, 0, -1], [20, 20, 1, 1], (700, 4))
    T = torch.from_numpy(np.stack([se3.from_xyz_rpy(x, y, z, yaw=a) for x, y, z, a in where]))
    scores = torch.from_numpy(rng.uniform(-1, 3, 700))
    expected: list[int] = []
    for row in scores.argsort(descending=True).tolist():
        free = all(bool(distinct(T[row][None], T[k][None])) for k in expected)
        if free and scores[row] > 0 and len(expected) < limit:
            expected.append(row)
    assert distinct_best(T, scores, limit) == expected
    assert distinct_best(T[:0], scores[:0], limit) == distinct_best(T, -scores.abs(), limit) == []


def test_several_are_refined_at_once_and_one_that_meets_nothing_stays(drive):
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    config = RefineConfig()
    source, target = (prepare(drive.scan(i), config) for i in (98, 90))
    rough = [T @ se3.from_xyz_rpy(x=x, yaw=0.02) for x in (0.5, -0.5, 500.0)]
    first, second, lost = refine_all(rough, source=source, target=target, config=config)
    assert metrics.rte(first.T_target_source, second.T_target_source) < 0.03
    assert metrics.rte(first.T_target_source, T) < 0.15
    alone = refine(rough[2], source=source, target=target, config=config)
    assert np.array_equal(alone.T_target_source, rough[2])
    assert metrics.rte(lost.T_target_source, rough[2]) < 1e-6


def test_refine_improves_a_rough_transform_and_refuses_to_walk(drive):
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    config = RefineConfig()
    source, target = (prepare(drive.scan(i), config) for i in (98, 90))
    rough = T @ se3.from_xyz_rpy(x=0.5, y=-0.3, yaw=0.02)
    fine = refine(rough, source=source, target=target, config=config)
    assert not fine.walked
    assert metrics.rte(fine.T_target_source, T) < 0.15
    assert metrics.rre_deg(fine.T_target_source, T) < 0.3
    assert np.linalg.eigvalsh(fine.information).min() > 0
    timid = refine(rough, source=source, target=target, config=RefineConfig(max_move=0.1))
    assert timid.walked
    assert np.array_equal(timid.T_target_source, rough)


@pytest.mark.parametrize(('along', 'slides'), [(1.0, True), (1e4, False)])
def test_what_nothing_holds_along_the_road_slides(along, slides):
    """A tunnel holds a scan across, upright and level, but not along."""
    turn = se3.rotation_z(0.7)
    information = np.diag([along, 1e5, 1e5, 1e6, 1e6, 1e6])
    information[:2, :2] = turn[:2, :2] @ information[:2, :2] @ turn[:2, :2].T
    assert Refined(np.eye(4), information, walked=False).slides == slides


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('limit', [0, 1, 40, 1000])
def test_compiled_choice_of_places_is_torchs(limit):
    rng = np.random.default_rng(0)
    where = rng.uniform([-20, -20, 0, -1], [20, 20, 1, 1], (700, 4))
    poses = [se3.from_xyz_rpy(x, y, z, yaw=a) for x, y, z, a in where]
    T, order = torch.from_numpy(np.stack(poses)).float(), torch.from_numpy(rng.permutation(700))
    limits = {'squared_distance': DISTINCT_DISTANCE**2, 'least_trace': LEAST_TRACE}
    expected = hypothesis._taken(T, order, limit) if limit else []
    assert distinct_rows(T, order, limit, **limits) == expected
    assert distinct_rows(T, order[:0], limit, **limits) == []
