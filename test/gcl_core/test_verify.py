"""Dense checks of true and of shifted alignments, on simulated scans."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.data.sequence import T_target_source
from gcl_core.estimation import verify as verify_module
from gcl_core.estimation.likeness import keypoint_grid, likeness
from gcl_core.estimation.surface import surface
from gcl_core.estimation.verify import verify
from gcl_core.types import Features, PointCloud

PAIRS = [(102, 90), (125, 95)]  # 12 m and 30 m apart


@pytest.fixture(scope='module', params=PAIRS, ids=str)
def pair(request, drive):
    source, target = request.param
    T = T_target_source(drive, source=source, target=target)
    return surface(drive.scan(source)), surface(drive.scan(target)), T


def check(pair, offsets):
    source, target, T = pair
    Ts = torch.from_numpy(np.stack([offset @ T for offset in offsets]))
    return verify(Ts, source=source, target=target, tolerance=0.5)


def test_true_alignment_fits(pair):
    fit = check(pair, [np.eye(4)])
    assert float(fit.conflict) < 0.05
    assert float(fit.surface) > 0.5
    assert float(fit.ground) > 0.8
    assert float(fit.overlap) > 500


@pytest.mark.parametrize(
    'offset',
    [
        se3.from_xyz_rpy(x=4.0),
        se3.from_xyz_rpy(x=-8.0),
        se3.from_xyz_rpy(y=3.0),
        se3.from_xyz_rpy(yaw=np.pi),
        se3.from_xyz_rpy(yaw=0.2),
    ],
    ids=['along 4 m', 'along -8 m', 'across 3 m', 'half turn', '11 degrees'],
)
def test_shifted_alignments_are_in_conflict(pair, offset):
    fit = check(pair, [np.eye(4), offset])
    assert float(fit.conflict[1]) > float(fit.conflict[0]) + 0.04
    assert float(fit.surface[1]) < float(fit.surface[0]) - 0.1
    assert float(fit.close[1]) < 0.7 * float(fit.close[0])


def test_raised_vehicle_stands_off_the_ground(pair):
    fit = check(pair, [np.eye(4), se3.from_xyz_rpy(z=1.0)])
    assert float(fit.ground[1]) < 0.3 < float(fit.ground[0])


def test_what_lies_behind_a_wall_is_no_conflict():
    rng = np.random.default_rng(0)
    y, z = rng.uniform(-10, 10, 4000), rng.uniform(-1.5, 3.0, 4000)
    ground = np.stack(
        [rng.uniform(-20, 20, 4000), rng.uniform(-20, 20, 4000), np.full(4000, -1.8)]
    )

    def wall(x):
        points = np.concatenate([np.stack([np.full(4000, x), y, z], 1), ground.T])
        return surface(PointCloud(points.astype(np.float32)))

    near, far = wall(8.0), wall(16.0)
    here = torch.eye(4)[None]
    both = verify(here, source=far, target=near, tolerance=0.5)
    # The far scan saw through the near wall; the near one could not see the far wall.
    assert float(both.conflict) > 0.5
    same = verify(here, source=far, target=far, tolerance=0.5)
    assert float(same.conflict) == 0.0
    assert float(same.surface) > 0.95


def test_out_of_sight_says_nothing(pair):
    fit = check(pair, [se3.from_xyz_rpy(x=1000.0)])
    assert float(fit.surface) == float(fit.close) == float(fit.ground) == 0.0


def test_alike_features_that_meet_score_above_chance():
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(800, 3, generator=generator) * torch.tensor([60.0, 60.0, 8.0]) - 30.0
    descriptors = torch.nn.functional.normalize(torch.randn(800, 16, generator=generator), dim=1)
    points[:100, 2] = -40.0  # ground far below, so that the others are raised
    points[100:, 2] += 35.0
    features = Features(points, descriptors)
    shuffled = Features(points, descriptors[torch.randperm(800, generator=generator)])
    eye = torch.eye(4)[None]
    grid = keypoint_grid(features)
    score, met = likeness(eye, features, grid)
    assert float(score) > 2.0
    assert float(met) > 300
    assert abs(float(likeness(eye, shuffled, grid)[0])) < 0.3
    away = torch.from_numpy(se3.from_xyz_rpy(x=500.0))[None]
    assert float(likeness(away, features, grid)[1]) == 0


def everywhere(T, count=40, seed=0):
    """The transform, some around it, and some of which nothing is right; one far away."""
    rng = np.random.default_rng(seed)
    moves = [rng.normal(size=6) * scale for scale in (0.05, 0.5, 5.0) for _ in range(count // 3)]
    away = [np.eye(4), se3.from_xyz_rpy(x=1000.0)]
    offsets = [*away, *(se3.from_xyz_rpy(*m[:3], *(m[3:] / 5)) for m in moves)]
    return torch.from_numpy(np.stack([offset @ T for offset in offsets])).float()


@pytest.mark.usefixtures('compiled')
def test_compiled_counts_are_torchs(pair):
    source, target, T = pair
    Ts = everywhere(T)
    counts = verify_module._counted(Ts, source, target, 0.7)
    assert int(counts.amax(0).min()) > 100
    for threads in (1, 3):
        ours = counted_with(threads, Ts, source, target)
        assert torch.equal(torch.stack(ours, 1), counts.float())


def counted_with(threads, Ts, source, target):
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(threads)
        return verify_module._one_way(Ts, source, target, 0.7)
    finally:
        torch.set_num_threads(before)


@pytest.mark.usefixtures('compiled')
def test_nothing_is_counted_where_there_is_nothing(pair):
    source, target, T = pair
    none = replace(source, solid=source.solid[:0], ground=source.ground[:0])
    Ts = torch.from_numpy(T).float()[None]
    assert not torch.stack(verify_module._one_way(Ts, none, target, 0.7)).any()
    assert torch.stack(verify_module._one_way(Ts[:0], source, target, 0.7)).shape == (6, 0)
