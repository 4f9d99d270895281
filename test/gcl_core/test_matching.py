import pytest
import torch

from gcl_core.matching.keypoints import choose, spread
from gcl_core.matching.match import MatchConfig, finite, match
from gcl_core.types import Correspondences, Features


def features(count, seed):
    generator = torch.Generator().manual_seed(seed)
    descriptors = torch.randn(count, 16, generator=generator)
    points = 50 * torch.rand(count, 3, generator=generator)
    return Features(points, torch.nn.functional.normalize(descriptors, dim=1))


def part(f, rows):
    return Features(f.points[rows], f.descriptors[rows])


def test_mutual_matches_across_chunks():
    f = features(2500, seed=0)
    order = torch.randperm(2500, generator=torch.Generator().manual_seed(1))
    matches = match(source=f, target=part(f, order[:2000]), config=MatchConfig())
    exact = matches.weight > 0.9999
    assert int(exact.sum()) == 2000
    torch.testing.assert_close(matches.source[exact], matches.target[exact])


@pytest.mark.parametrize('counts', [(300, 700), (700, 300), (65, 1)])
def test_mutual_matches_are_those_of_the_full_matrix(counts, monkeypatch):
    monkeypatch.setattr('gcl_core.matching.match.best_dtype', lambda: torch.float32)
    source, target = (features(n, seed=i) for i, n in enumerate(counts))
    matches = match(source=source, target=target, config=MatchConfig())
    s = source.descriptors @ target.descriptors.t()
    mutual = (s == s.amax(1, keepdim=True)) & (s == s.amax(0))
    columns, rows = mutual.t().nonzero(as_tuple=True)  # in the order of the target
    assert torch.equal(matches.source, source.points[rows])
    assert torch.equal(matches.target, target.points[columns])


def test_equal_descriptors_match_each_row_once():
    f = features(1, seed=0)
    copies = Features(torch.rand(70, 3), f.descriptors.expand(70, -1))
    assert len(match(source=copies, target=copies, config=MatchConfig())) == 1


def test_one_way_and_top_k():
    source, target = features(300, seed=0), features(200, seed=1)
    assert len(match(source=source, target=target, config=MatchConfig(kind='one_way'))) == 300
    matches = match(source=source, target=target, config=MatchConfig(kind='top_k', k=3))
    assert len(matches) == 900
    similarity = source.descriptors @ target.descriptors.t()
    torch.testing.assert_close(
        matches.weight.view(300, 3).mean(), similarity.topk(3, 1).values.mean(), rtol=1e-2, atol=0
    )


@pytest.mark.parametrize('kind', ['mutual', 'one_way', 'top_k'])
def test_nothing_matches_nothing(kind):
    none, some = features(0, seed=0), features(5, seed=1)
    for source, target in ((none, some), (some, none), (none, none)):
        assert len(match(source=source, target=target, config=MatchConfig(kind=kind))) == 0


def test_key_points_are_spread_in_space():
    generator = torch.Generator().manual_seed(0)
    dense = torch.rand(5000, 3, generator=generator) * 4.0
    sparse = torch.rand(100, 3, generator=generator) * 100.0 + 20.0
    points = torch.cat([dense, sparse])
    rows = spread(points, 200)
    assert len(rows) == len(rows.unique()) == 200
    assert int((rows >= 5000).sum()) >= 90
    at_random = choose(Features(points, points), 200, spatially=False)
    assert int((at_random.points[:, 0] > 4).sum()) < 20


def test_pairs_that_are_not_finite_are_dropped():
    source = torch.rand(6, 3)
    target, weight = source.clone(), torch.ones(6)
    source[0, 1], target[2, 0], weight[4] = torch.nan, torch.inf, torch.nan
    assert len(finite(Correspondences(source, target, weight))) == 3
