"""What correspondences a transform explains: exactly, in any units of work, compiled or not."""

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.estimation.procrustes import products
from gcl_core.estimation.support import Support
from gcl_core.types import Correspondences

COUNTS = [(1, 3), (5, 16), (70, 333), (9, 4000)]


def scene(transforms, count, seed=0):
    rng = np.random.default_rng(seed)
    source = rng.uniform([-60, -60, -3], [60, 60, 9], (count, 3))
    T = se3.from_xyz_rpy(8, -3, 0.3, yaw=0.4)
    target = se3.transform(T, source) + rng.normal(size=source.shape)
    around = [T @ se3.from_xyz_rpy(*rng.normal(size=3) / 3) for _ in range(transforms)]
    sides = (torch.from_numpy(side).float() for side in (source, target))
    weight = torch.from_numpy(rng.uniform(-0.2, 1, count)).float()
    return Correspondences(*sides, weight), torch.from_numpy(np.stack(around))


def explained(c, T, threshold):
    """Word for word, in float64."""
    off = T[:, :3, :3] @ c.source.double().t() + T[:, :3, 3:] - c.target.double().t()
    return off.norm(dim=1) < threshold


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize(('transforms', 'count'), COUNTS)
def test_compiled_scores_are_torchs(transforms, count):
    c, T = scene(transforms, count)
    support = Support(c, 1.5)
    expected = explained(c, T, 1.5).double() @ c.weight.double().clamp(min=0)
    assert float(expected.max()) > 0
    torch.testing.assert_close(support.scores(T).double(), expected, atol=1e-3, rtol=1e-5)
    torch.testing.assert_close(support.scores(T), support._by_blocks(T), atol=1e-3, rtol=1e-5)


@pytest.mark.usefixtures('compiled')
def test_scores_do_not_depend_on_threads():
    c, T = scene(70, 4000)
    support, threads, found = Support(c, 1.5), torch.get_num_threads(), []
    try:
        for count in (1, 2, 3, 5):
            torch.set_num_threads(count)
            found.append((support.scores(T), support._by_blocks(T)))
    finally:
        torch.set_num_threads(threads)
    assert all(torch.equal(a, b) for other in found for a, b in zip(found[0], other))


@pytest.mark.parametrize('threshold', [0.5, 0.05, 0.01, 0.001])
def test_exact_correspondences_are_inliers_however_small_the_threshold(threshold):
    """Far from both sensors, where float32 holds a square to less than a millimetre's."""
    rng = np.random.default_rng(1)
    source = rng.uniform(-1, 1, (2000, 3)) * [60, 60, 6]
    T = se3.from_xyz_rpy(50, -20, 1, 0.02, -0.03, 2.0)
    sides = (torch.from_numpy(side).float() for side in (source, se3.transform(T, source)))
    support = Support(Correspondences(*sides, torch.ones(2000)), threshold)
    T = torch.from_numpy(T)[None]
    assert int(support.inliers(T).sum()) == 2000
    assert float(support.scores(T)) == float(support._by_blocks(T)) == 2000
    (polished,) = support.polish(T, steps=4)
    assert polished.inliers == 2000


def test_moments_are_sums_of_the_inliers_products():
    c, T = scene(6, 500)
    support = Support(c, 1.0)
    inlier = support.inliers(T)
    inlier[2] = False
    weight = inlier * (c.weight.clamp(min=0) + 1e-6)
    expected = weight.double() @ products(c.source.double(), c.target.double())
    torch.testing.assert_close(support.moments(inlier), expected)
    assert not support.moments(inlier)[2].any()
    assert not support.moments(torch.zeros_like(inlier)).any()
