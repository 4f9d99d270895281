"""Positive groups on a toy, and every loss on groups computed by hand."""

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.data.groups import densest, draw_neighbors, find_groups, sample_groups
from gcl_core.errors import GclError
from gcl_core.losses.circle import circle
from gcl_core.losses.combined import LOWEST_TEMPERATURE, TERMS, LossConfig, combined
from gcl_core.losses.contrast import group_contrast
from gcl_core.losses.finest import finest
from gcl_core.losses.hardest_negative import hardest_negative
from gcl_core.losses.positive import positive_pair, positive_variance
from gcl_core.types import PositiveGroups


def toy() -> PositiveGroups:
    """Centre with 3 points; scan 1 sees the first two, scan 2 (4 m ahead) the first."""
    centre = [[5.0, 0, 0], [0, 6.0, 0], [0, 0, 9.0]]
    first = [[0.2, 6.0, 0], [5.0, 0.3, 0], [30, 30, 30]]
    second = [[1.1, 0.0, 0]]
    points = torch.tensor(centre + first + second)
    poses = np.stack([np.eye(4), np.eye(4), se3.from_xyz_rpy(x=4.0)])
    return find_groups(points, (0, 3, 6, 7), poses, radius=0.45)


def test_groups_of_a_toy():
    groups = toy()
    assert groups.offsets.tolist() == [0, 3, 5]
    assert groups.member.tolist() == [0, 4, 6, 1, 3]
    assert groups.finest.tolist() == [2, 3]  # 1.1 m from its sensor; 6 m against 6.003 m
    torch.testing.assert_close(groups.anchor, torch.tensor([[5.0, 0, 0], [0, 6.0, 0]]).double())


def test_the_densest_member_has_most_points_of_its_scan_around_it():
    centre = [[5.0, 0, 0]]
    scan = [[5.2, 0, 0], [5.2, 0.5, 0], [5.2, -0.5, 0], [30.0, 0, 0]]
    points = torch.tensor(centre + scan)
    groups = find_groups(points, (0, 1, 5), np.stack([np.eye(4)] * 2), radius=0.45)
    assert groups.member[groups.finest].tolist() == [0]  # nearest to its sensor
    assert groups.member[densest(groups, points, (0, 1, 5)).finest].tolist() == [1]


def test_sampled_groups_keep_their_members():
    groups = toy()
    one = sample_groups(groups, 1, torch.Generator().manual_seed(0))
    kept = 0 if one.anchor[0, 0] == 5 else 1
    a, b = groups.offsets[kept], groups.offsets[kept + 1]
    assert torch.equal(one.member, groups.member[a:b])
    assert int(one.finest[0]) == int(groups.finest[kept] - a)


def test_one_neighbor_from_each_segment():
    line = np.stack([np.arange(-100.0, 101.0), np.zeros(201), np.zeros(201)], 1)
    drawn = draw_neighbors(line, 100, 6, np.random.default_rng(0))
    signed = np.array(drawn) - 100
    assert np.array_equal(np.floor(signed / 20), [-3, -2, -1, 0, 1, 2])


FEATURES = torch.tensor([[1.0, 0.0], [0.0, 1.0], [0.6, 0.8], [-1.0, 0.0]])


def groups_of(*rows: list[int], finest_at: list[int]) -> PositiveGroups:
    sizes = torch.tensor([len(r) for r in rows])
    offsets = torch.cat([torch.zeros(1, dtype=torch.long), sizes.cumsum(0)])
    member = torch.tensor([m for r in rows for m in r])
    anchor = torch.arange(len(rows))[:, None].double() * torch.tensor([[10.0, 0, 0]]).double()
    return PositiveGroups(
        offsets, member, torch.ones(len(member)), torch.tensor(finest_at), anchor
    )


def test_positive_variance_by_hand():
    groups = groups_of([0, 1], finest_at=[0])
    # The mean is (0.5, 0.5); each member is sqrt(0.5) away.
    assert positive_variance(FEATURES, groups).item() == pytest.approx(0.5**0.5 - 0.1)
    assert positive_variance(FEATURES, groups, squared=True).item() == pytest.approx(0.5 - 0.1)


def test_finest_by_hand():
    groups = groups_of([0, 1], [2, 3], finest_at=[1, 2])
    # Distances to the mean: sqrt(0.5) in the first group; (0.6, 0.8) - (-0.2, 0.4) in the second.
    distances = [0.5**0.5, (0.64 + 0.16) ** 0.5]
    expected = np.mean([d - 0.2 for d in distances])
    assert finest(FEATURES, groups).item() == pytest.approx(expected)
    squared = np.mean([d**2 - 0.2 for d in distances])
    assert finest(FEATURES, groups, squared=True).item() == pytest.approx(squared)


def test_positive_pair_of_a_pair_is_their_distance():
    groups = groups_of([0, 2], finest_at=[0])
    loss = positive_pair(FEATURES, groups, generator=torch.Generator().manual_seed(0))
    assert loss.item() == pytest.approx((0.16 + 0.64) ** 0.5 - 0.1)


def test_hardest_negative_ignores_the_own_group():
    groups = groups_of([0, 2], [1, 3], finest_at=[0, 2])
    loss = hardest_negative(FEATURES, groups, generator=torch.Generator().manual_seed(0))
    nearest = [2.0**0.5, 0.4**0.5, 0.4**0.5, 2.0]  # of rows 0, 2, 1, 3 to the other group
    assert loss.item() == pytest.approx(np.mean([max(0, 1.4 - d) for d in nearest]), abs=1e-6)


def test_contrast_by_hand_and_safe_radius():
    groups = groups_of([0, 2], [1, 3], finest_at=[0, 2])
    loss = group_contrast(FEATURES, groups, temperature=1.0)
    f = FEATURES.numpy()
    terms = []
    for i, j, negatives in ((0, 2, (1, 3)), (2, 0, (1, 3)), (1, 3, (0, 2)), (3, 1, (0, 2))):
        scores = [f[i] @ f[j], *(f[i] @ f[n] for n in negatives)]
        terms.append(np.log(np.exp(scores).sum()) - scores[0])
    assert loss.item() == pytest.approx(np.mean(terms), rel=1e-5)
    assert group_contrast(FEATURES, groups, safe_radius=50.0).item() < 1e-5


def test_blocked_finest_has_the_value_of_finest_but_not_its_gradient():
    groups = groups_of([0, 1], [2, 3], finest_at=[1, 2])
    gradients = []
    for blocked in (False, True):
        f = FEATURES.clone().requires_grad_()
        loss = finest(f, groups, blocked=blocked)
        assert loss.item() == pytest.approx(finest(FEATURES, groups).item())
        gradients.append(torch.autograd.grad(loss, f)[0])
    # |finest - mean| of (a, b) with b the finest: half of (b - a); blocked, only the mean moves.
    torch.testing.assert_close(gradients[1][1], -gradients[0][1])
    torch.testing.assert_close(gradients[1][0], gradients[0][0])


def test_circle_by_hand():
    groups = groups_of([0, 2], [1, 3], finest_at=[0, 2])
    loss = circle(FEATURES, groups, generator=torch.Generator(), log_scale=2.0)
    f, terms = FEATURES.numpy(), []
    for i, j, negatives in ((0, 2, (1, 3)), (2, 0, (1, 3)), (1, 3, (0, 2)), (3, 1, (0, 2))):
        positive = 2.0 * (np.linalg.norm(f[i] - f[j]) - 0.1) ** 2
        far = [np.linalg.norm(f[i] - f[n]) for n in negatives]
        negative = np.log(sum(np.exp(2.0 * (1.4 - d) * max(1.4 - d, 0)) for d in far))
        terms.append(np.log1p(np.exp(positive + negative)) / 2.0)
    assert loss.item() == pytest.approx(np.mean(terms), rel=1e-5)


def test_groups_of_two_are_the_pair_wise_loss():
    """FCGF's hardest-contrastive loss, written as its paper writes it (Choy et al., eq. 4)."""
    torch.manual_seed(2)
    f = torch.nn.functional.normalize(torch.randn(8, 16), dim=1)
    groups = groups_of([0, 4], [1, 5], [2, 6], [3, 7], finest_at=[0, 2, 4, 6])
    config = LossConfig(contrast=0, variance=0, finest=0, pair=1, negative=1, gcl_from=0)
    ours, parts = combined(f, groups, config, progress=0.0, generator=torch.Generator())
    a, b = f[:4], f[4:]
    positive = ((a - b).square().sum(1) - 0.1).relu().mean()
    everything = torch.cdist(f, f)
    own = torch.arange(8) % 4
    everything[own[:, None] == own[None]] = 9.0
    negative = (1.4 - everything.min(1).values).relu().square().mean()
    assert parts['pair'] == pytest.approx(positive.item(), rel=1e-5)
    assert ours.item() == pytest.approx((positive + negative).item(), rel=1e-4)


def test_a_temperature_that_overflows_is_refused():
    groups = toy()
    features = torch.nn.functional.normalize(torch.ones(7, 4), dim=1)
    assert group_contrast(features, groups, temperature=LOWEST_TEMPERATURE).isfinite()
    with pytest.raises(GclError, match='the softmax overflows'):
        LossConfig(temperature=0.9 * LOWEST_TEMPERATURE)


def test_safe_radius_of_a_recipe_is_that_of_the_softmax():
    groups = groups_of([0, 2], [1, 3], finest_at=[0, 2])
    far = LossConfig(temperature=1.0, safe_radius=50.0)
    _, parts = combined(FEATURES, groups, far, progress=0.0, generator=torch.Generator())
    assert parts['contrast'] < 1e-5
    with pytest.raises(GclError, match='safe_radius is 0'):
        LossConfig(safe_radius=0.0)


def test_a_recipe_that_learns_nothing_at_first_is_refused():
    with pytest.raises(GclError, match='set gcl_from to 0'):
        LossConfig(contrast=0, gcl_from=0.5)


def test_losses_join_when_the_recipe_says():
    groups = groups_of([0, 2], [1, 3], finest_at=[0, 2])
    config = LossConfig(gcl_from=0.5)
    names = []
    for progress in (0.2, 0.8):
        _, parts = combined(
            FEATURES, groups, config, progress=progress, generator=torch.Generator()
        )
        names.append(set(parts))
    assert names == [{'contrast'}, {'contrast', 'variance', 'finest', 'negative'}]
    assert (config.ramp(0.5), config.ramp(0.75), config.ramp(1.0)) == (0.0, 1.0, 1.0)


@pytest.mark.parametrize('weights', [{'pair': -1.0}, dict.fromkeys(TERMS, 0.0)])
def test_weights_that_make_no_loss_are_refused(weights):
    with pytest.raises(GclError, match='loss weights'):
        LossConfig(**weights)


@pytest.mark.parametrize(
    'loss',
    [
        lambda f, g: positive_variance(f, g),
        lambda f, g: positive_variance(f, g, squared=True),
        lambda f, g: finest(f, g),
        lambda f, g: positive_pair(f, g, generator=torch.Generator().manual_seed(0)),
        lambda f, g: hardest_negative(f, g, generator=torch.Generator().manual_seed(0)),
        lambda f, g: group_contrast(f, g),
    ],
)
def test_gradients(loss):
    torch.manual_seed(0)
    features = torch.nn.functional.normalize(torch.randn(6, 4, dtype=torch.float64), dim=1)
    groups = groups_of([0, 1, 2], [3, 4, 5], finest_at=[1, 3])
    assert torch.autograd.gradcheck(lambda f: loss(f, groups), features.requires_grad_())


def test_identical_members_give_finite_gradients():
    features = torch.ones(4, 2, requires_grad=True)
    groups = groups_of([0, 1], [2, 3], finest_at=[0, 2])
    total = positive_variance(features, groups) + finest(features, groups)
    total = total + hardest_negative(features, groups, generator=torch.Generator())
    total.backward()
    assert features.grad.isfinite().all()
