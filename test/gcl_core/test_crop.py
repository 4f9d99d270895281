import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from gcl_core import se3
from gcl_core.estimation import crop
from gcl_core.estimation.crop import meeting
from gcl_core.ops.native.crop import near


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), reach=st.floats(0.3, 5.0))
def test_whatever_can_meet_is_kept_and_little_else(seed, reach):
    rng = np.random.default_rng(seed)
    source, target = (rng.uniform(-30, 30, (300, 3)).astype(np.float32) for _ in range(2))
    Ts = [se3.from_xyz_rpy(*rng.uniform(-20, 20, 3), yaw=rng.uniform(-3, 3)) for _ in range(2)]
    kept, kept_target = meeting(source, target, Ts, reach)
    away = np.min([cKDTree(target).query(se3.transform(T, source))[0] for T in Ts], 0)
    rows = {tuple(p) for p in kept}
    assert all(tuple(p) in rows for p in source[away < reach - 1e-3])
    assert not any(tuple(p) in rows for p in source[away > 3.5 * reach])
    back = [cKDTree(source).query(se3.transform(se3.inverse(T), target))[0] for T in Ts]
    assert {tuple(p) for p in target[np.min(back, 0) < reach - 1e-3]} <= set(
        map(tuple, kept_target)
    )


@pytest.mark.parametrize('T', [[], [se3.from_xyz_rpy(x=1e6)]], ids=['none', 'far away'])
def test_nothing_meets(T):
    points = np.random.default_rng(0).uniform(-5, 5, (50, 3)).astype(np.float32)
    assert [len(p) for p in meeting(points, points, T, 1.0)] == [0, 0]


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('count', [1, 3000])
def test_compiled_choice_is_numpys(count):
    rng = np.random.default_rng(count)
    points, others = (rng.uniform(-30, 30, (count, 3)).astype(np.float32) for _ in range(2))
    Ts = [se3.from_xyz_rpy(*rng.uniform(-9, 9, 3), yaw=rng.uniform(-3, 3)) for _ in range(2)]
    for some in (Ts[:1], Ts, [Ts[0].copy('F')], [se3.from_xyz_rpy(x=1e6)]):
        for at in (others, points):
            ours = near(points, at, np.stack(some), 1.3)
            np.testing.assert_array_equal(ours, crop._held(points, at, some, 1.3))
