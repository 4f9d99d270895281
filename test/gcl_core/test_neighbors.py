"""Radius neighbours, grid subsampling, limits: against brute force, and under rigid motion."""

import emulation
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from gcl_core.errors import GclError
from gcl_core.ops import neighbors
from gcl_core.ops.grid_subsample import grid_subsample
from gcl_core.ops.point_pyramid import build_point_pyramid
from gcl_core.ops.voxelize import encode, voxelize
from gcl_core.types import PointCloud

RADIUS = 1.3


def random_points(count: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return (torch.rand(count, 3, generator=generator) - 0.5) * 6.0


def sets(table: torch.Tensor, count: int) -> list[set[int]]:
    return [set(row[row < count].tolist()) for row in table]


@pytest.fixture(params=[*emulation.sets(), 'tree'])
def search(request, monkeypatch):
    """Both ways to search."""
    if request.param == 'tree':
        monkeypatch.setattr(neighbors, 'radius_search', lambda *_, **__: None)
    else:
        emulation.hold(request.param, monkeypatch)
    return neighbors.radius_neighbors


def test_same_as_all_distances(search):
    queries, support = random_points(200), random_points(300, 1)
    distance = torch.cdist(queries.double(), support.double())
    table, counts = search(queries, support, radius=RADIUS, limit=12)
    assert (counts == (distance <= RADIUS).sum(1)).all()
    assert counts.max() > 12  # the limit cuts some
    for i, row in enumerate(table):
        order = distance[i].argsort()[: min(12, int(counts[i]))]
        assert row[: len(order)].tolist() == order.tolist()
        assert (row[len(order) :] == len(support)).all()


def test_rigid_motion_keeps_neighbour_sets(search):
    points = random_points(400, 2)
    turn = torch.from_numpy(Rotation.random(random_state=3).as_matrix()).float()
    moved = points @ turn.t() + torch.tensor([30.0, -7.0, 2.0])
    distance = torch.cdist(points.double(), points.double())
    assert ((distance - RADIUS).abs() > 1e-5).all()  # none on the edge
    (a, _), (b, _) = (search(p, p, radius=RADIUS, limit=400) for p in (points, moved))
    assert sets(a, 400) == sets(b, 400)


def test_empty_and_single(search):
    one, none = torch.ones(1, 3), torch.zeros(0, 3)
    table, counts = search(one, none, radius=1.0, limit=3)
    assert table.tolist() == [[0, 0, 0]]
    assert counts.tolist() == [0]
    table, counts = search(none, one, radius=1.0, limit=3)
    assert table.shape == (0, 3)
    assert counts.shape == (0,)
    table, counts = search(one, one, radius=1.0, limit=3)
    assert table.tolist() == [[0, 1, 1]]
    assert counts.tolist() == [1]


def test_points_on_the_radius_and_across_cells_count(search):
    support = torch.tensor([[2.0, 0, 0], [-2.0, 0, 0], [0, 0, 2.0], [0, 2.001, 0]])
    table, counts = search(torch.zeros(1, 3), support, radius=2.0, limit=4)
    assert counts.tolist() == [3]
    assert sets(table, 4) == [{0, 1, 2}]


def test_points_far_from_the_origin_are_searched(search):
    far = random_points(50, 4) + torch.tensor([3e6, 0, 0])
    table, _ = search(far, far, radius=RADIUS, limit=50)
    expected = torch.cdist(far.double(), far.double()) <= RADIUS
    assert sets(table, 50) == [set(row.nonzero().ravel().tolist()) for row in expected]


def test_bad_radius_is_named():
    with pytest.raises(GclError, match='radius is 0'):
        neighbors.radius_neighbors(torch.ones(1, 3), torch.ones(1, 3), radius=0.0, limit=1)


def test_limit_leaves_most_points_whole():
    counts = torch.arange(1, 101, dtype=torch.int32)
    assert neighbors.limit_of(counts, 0.8) == 80
    assert neighbors.limit_of(torch.full((7,), 5, dtype=torch.int32), 0.8) == 5
    with pytest.raises(GclError, match='0 counts'):
        neighbors.limit_of(counts[:0])


def test_subsampling_gives_barycentres():
    coords = torch.tensor([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    points = torch.tensor([[0.1, 0.0, 0.0], [0.4, 0.2, 0.0], [0.7, 0.0, 0.0]])
    keys, centres = grid_subsample(encode(coords), points)
    assert len(keys) == 2
    torch.testing.assert_close(centres, torch.tensor([[0.25, 0.1, 0.0], [0.7, 0.0, 0.0]]))


def test_pyramid_of_two_scans_keeps_them_apart():
    rng = np.random.default_rng(5)
    clouds = [PointCloud(rng.uniform(-4, 4, (n, 3)).astype(np.float32)) for n in (400, 1)]
    voxels = voxelize(clouds, voxel_size=0.3, max_range=80.0)
    pyramid = build_point_pyramid(voxels, cell=0.3, reach=4.25, limits=(20, 20, 20))
    for level, (points, splits) in enumerate(zip(pyramid.points, pyramid.splits, strict=True)):
        assert splits[-1] == len(points)
        assert splits[1] == len(points) - 1  # the second scan is one point in each level
        own = pyramid.same[level][-1]
        assert own[0] == len(points) - 1
        assert (own[1:] == len(points)).all()
        if level < 2:
            first, coarse = points[: splits[1]].double(), pyramid.points[level + 1].double()
            apart = (first - coarse[pyramid.up[level][: splits[1]]]).norm(dim=1)
            torch.testing.assert_close(apart, torch.cdist(first, coarse[:-1]).amin(1))
