"""Products and sums whose bits do not depend on threads; the registration takes no others."""

import math

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from gcl_core import se3
from gcl_core.estimation.estimators import EstimatorConfig
from gcl_core.estimation.ransac import RansacConfig
from gcl_core.ops import repeatable
from gcl_core.registrar import Registrar, RegistrarConfig

SHARED = 1 << 15  # numbers from which on torch shares work among threads
NATIVE = 400  # multiplications of a small product; torch does a batch of those itself
SMALL = 6  # edge of a matrix that no library shares among threads
PRODUCTS = {'mm', 'addmm', 'bmm', 'baddbmm', 'mv', 'addmv', 'dot', '_euclidean_dist'}
SUMS = {'sum', 'mean', 'var', 'std', 'norm', 'linalg_vector_norm', 'prod', 'cumsum', 'logsumexp'}
BY_ROW = {'linalg_vector_norm', 'linalg_cross'}
CURVES = {'atan2', 'sin', 'cos', 'tan', 'exp', 'log', 'log1p', 'tanh', 'sigmoid', 'pow', 'acos'}


def is_count(t) -> bool:
    """Whether sums of a matrix's numbers, 0 and 1, are exact in any order."""
    return bool(((t == 0) | (t == 1)).all()) and max(t.shape) < 1 << 24


def depends_on_threads(name, arguments, out) -> str | None:
    """Why the bits of a step may depend on the number of threads; None if they do not."""
    tensors = [a for a in arguments if isinstance(a, torch.Tensor) and a.is_floating_point()]
    if not tensors:
        return None
    shapes = [tuple(t.shape) for t in tensors]
    if name == 'pow' and arguments[1] == 2:  # a product of one number with itself
        return None
    if name == 'mm' and all(is_count(t) for t in tensors):
        return None
    if name == 'bmm' and math.prod(shapes[0][1:]) * shapes[1][2] < NATIVE:
        return None
    routine = name.strip('_').startswith('linalg_') and name not in BY_ROW
    if (routine or name in PRODUCTS) and max(max(shape[-2:]) for shape in shapes) > SMALL:
        return f'{name} of {shapes}: the library shares it out'
    if name in SUMS and tensors[0].numel() >= SHARED:
        along = next((a for a in arguments[1:] if isinstance(a, list)), [])
        if [axis % tensors[0].dim() for axis in along] != [tensors[0].dim() - 1]:
            return f'{name} of {shapes} along {along}: parts are added up by thread'
    if name in CURVES and tensors[0].numel() >= SHARED:
        return f"{name} of {shapes}: the last numbers of a thread's part are rounded otherwise"
    return None


class Watching(TorchDispatchMode):
    """Notes the steps of torch whose bits may depend on the number of threads."""

    def __init__(self):
        super().__init__()
        self.found, self.steps = set(), 0

    def __torch_dispatch__(self, function, types, arguments=(), keywords=None):
        out = function(*arguments, **(keywords or {}))
        self.steps += 1
        name = function.overloadpacket.__name__.rstrip('_')
        why = depends_on_threads(name, arguments, out)
        if why:
            self.found.add(why)
        return out


@pytest.mark.parametrize(
    'spoilt',
    [
        lambda x: x.t() @ x,
        lambda x: x @ x[0],
        lambda x: x.mean(0),
        lambda x: x.sum(),
        lambda x: torch.cos(x),
        lambda x: torch.cdist(x[:2000], x[:2000]),
        lambda x: torch.einsum('nk,km->nm', x, x[:7]),
        lambda x: torch.linalg.svd(x[:40]),
    ],
)
def test_the_watch_sees_what_depends_on_threads(spoilt):
    with Watching() as watching:
        spoilt(numbers(SHARED, 7))
    assert watching.found


ESTIMATORS = {
    'level': EstimatorConfig(),
    'rigid': EstimatorConfig(ransac=RansacConfig(model='rigid')),
    'spatial_consistency': EstimatorConfig(name='spatial_consistency'),
}


@pytest.mark.parametrize('estimator', ESTIMATORS.values(), ids=ESTIMATORS)
@pytest.mark.parametrize('plain', [False, True], ids=['compiled', 'plain torch'])
def test_no_step_of_a_registration_depends_on_threads(estimator, plain, drive, monkeypatch):
    """In plain torch the network and the search in feature space are not watched."""
    registrar = Registrar(RegistrarConfig(headings=1, estimator=estimator))
    with Watching() as watching:
        source, target = (registrar.view(drive.scan(i)) for i in (98, 90))
    described = set() if registrar.engine.endswith('plain torch') else watching.found
    if plain:
        monkeypatch.setenv('GCL_NATIVE', '0')
    with Watching() as watching:
        result = registrar.register_views(source=source, target=target)
    assert result.accepted
    assert watching.steps > 1000
    assert described | watching.found == set()


def threads_agree(compute) -> None:
    threads, found = torch.get_num_threads(), []
    try:
        for count in (1, 2, 3, 5):
            torch.set_num_threads(count)
            found.append(compute())
    finally:
        torch.set_num_threads(threads)
    assert all(torch.equal(found[0], other) for other in found)


@pytest.fixture(params=['compiled', 'plain'])
def engine(request, monkeypatch):
    if request.param == 'plain':
        monkeypatch.setenv('GCL_NATIVE', '0')


def numbers(*shape):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(0))


@pytest.mark.usefixtures('engine')
@pytest.mark.parametrize('count', [1, 7, 5000])
def test_products(count):
    a, b, c = numbers(count, 32), numbers(32, 20), numbers(count, 9)
    torch.testing.assert_close(repeatable.product(a, b), a @ b, atol=1e-4, rtol=1e-5)
    torch.testing.assert_close(repeatable.gram(a, c), a.t() @ c, atol=1e-3, rtol=1e-4)
    for bias in (None, numbers(20)):
        expected = a @ b if bias is None else a @ b + bias
        torch.testing.assert_close(repeatable.linear(a, b, bias), expected, atol=1e-4, rtol=1e-5)
    threads_agree(lambda: repeatable.product(a, b))
    threads_agree(lambda: repeatable.gram(a, a))


@pytest.mark.parametrize('shape', [(1, 0), (3, 5), (1, 100_003), (70, 3001)])
def test_row_sums(shape):
    x = numbers(*shape)
    torch.testing.assert_close(repeatable.row_sums(x), x.sum(1), atol=1e-3, rtol=1e-4)
    threads_agree(lambda: repeatable.row_sums(x))


def test_moved_points_are_transformed_ones():
    points = 30 * numbers(5000, 3).double()
    Ts = [se3.from_xyz_rpy(1, 2, 3, 0.1, 0.2, yaw) for yaw in (0.0, 1.0)]
    found = repeatable.moved(torch.from_numpy(np.stack(Ts)), points)
    for ours, T in zip(found, Ts, strict=True):
        np.testing.assert_allclose(ours.t().numpy(), se3.transform(T, points.numpy()), atol=1e-12)
