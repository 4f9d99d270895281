"""KPConv against the double loop of its definition, its gradients, its kernel points."""

import emulation
import numpy as np
import pytest
import torch

from gcl_core.ops import kpconv, neighbor_max
from gcl_core.ops.kernel_points import kernel_points
from gcl_core.ops.kpconv import KPConv, influences
from gcl_core.ops.neighbors import radius_neighbors

EXTENT, RADIUS = 0.6, 1.3
KERNEL = torch.from_numpy(kernel_points(15)) * 1.5 * EXTENT


def scene(outputs: int, inputs: int, dtype=torch.float32):
    generator = torch.Generator().manual_seed(1)
    x, y = (2 * torch.rand(n, 3, generator=generator) for n in (outputs, inputs))
    table, _ = radius_neighbors(x, y, radius=RADIUS, limit=24)
    return x.to(dtype), y.to(dtype), table


def felt_by(outputs, inputs, table):
    return influences(outputs, inputs, table, KERNEL.to(outputs.dtype), EXTENT)


@pytest.fixture(params=[*emulation.sets(), 'torch'])
def engine(request, monkeypatch):
    """Both ways to compute."""
    if request.param == 'torch':
        for name in ('influence_entries', 'gathered', 'inverted'):
            monkeypatch.setattr(kpconv, name, lambda *_: None)
        monkeypatch.setattr(neighbor_max, 'neighbor_max_rows', lambda *_: None)
    else:
        emulation.hold(request.param, monkeypatch)


def double_loop(features, weight, outputs, inputs, table):
    """KPConv, equations 1 to 3 of the paper, word for word."""
    out = torch.zeros(len(outputs), weight.shape[2])
    for i, row in enumerate(table):
        for j in row[row < len(inputs)].long():
            for k, point in enumerate(KERNEL.float()):
                distance = (inputs[j] - outputs[i] - point).norm()
                influence = max(0.0, 1.0 - float(distance) / EXTENT)
                out[i] += influence * features[j] @ weight[k]
    return out


@pytest.mark.usefixtures('engine')
@pytest.mark.parametrize(('m', 'n'), [(20, 30), (1, 1), (3, 60)])
@pytest.mark.parametrize('chunk', [1 << 22, 1])
def test_same_as_a_double_loop(m, n, chunk, monkeypatch):
    monkeypatch.setattr(kpconv, 'CHUNK_VALUES', chunk)
    monkeypatch.setattr(kpconv, 'INFLUENCE_VALUES', chunk)
    outputs, inputs, table = scene(m, n)
    conv = KPConv(4, 5, 15)
    features = torch.randn(n, 4, generator=torch.Generator().manual_seed(2))
    ours = conv(features, felt_by(outputs, inputs, table))
    expected = double_loop(features, conv.weight.detach(), outputs, inputs, table)
    torch.testing.assert_close(ours, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.usefixtures('engine')
@pytest.mark.parametrize(('m', 'n'), [(0, 5), (5, 0), (0, 0)])
def test_empty(m, n):
    outputs, inputs, table = scene(m, n)
    conv, features = KPConv(4, 6, 15), torch.ones(n, 4, requires_grad=True)
    out = conv(features, felt_by(outputs, inputs, table))
    assert out.shape == (m, 6)
    assert not out.any()
    out.sum().backward()
    assert features.grad.shape == (n, 4)
    assert not conv.weight.grad.any()


@pytest.mark.parametrize('chunk', [1 << 22, 1])
def test_gradients(chunk, monkeypatch):
    monkeypatch.setattr(kpconv, 'CHUNK_VALUES', chunk)
    outputs, inputs, table = scene(6, 9, torch.float64)
    felt = felt_by(outputs, inputs, table)
    assert len(felt.value) > 20
    conv = KPConv(2, 3, 15).double()
    features = torch.randn(9, 2, dtype=torch.float64, requires_grad=True)
    parameters = (features, conv.weight)
    assert torch.autograd.gradcheck(lambda x, _: conv(x, felt), parameters)


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('channels', [2, 16, 20, 64, 80])
@pytest.mark.parametrize('dtype', [torch.float32, torch.bfloat16])
def test_compiled_is_torch_forwards_and_backwards(channels, dtype, monkeypatch):
    outputs, inputs, table = scene(120, 150)
    conv, generator = KPConv(channels, 48, 15), torch.Generator().manual_seed(4)
    features = torch.randn(150, channels, generator=generator).to(dtype).requires_grad_()
    weight = torch.randn(120, 48, generator=generator).to(dtype)

    def both():
        out = conv(features, felt_by(outputs, inputs, table))
        return out, *torch.autograd.grad((out * weight).sum(), [features, conv.weight])

    compiled = both()
    for name in ('influence_entries', 'gathered', 'inverted'):
        monkeypatch.setattr(kpconv, name, lambda *_: None)
    for ours, theirs in zip(compiled, both(), strict=True):
        assert ours.dtype == theirs.dtype
        error = (ours - theirs).float().norm() / theirs.float().norm()
        assert float(error) < (1e-5 if dtype == torch.float32 else 1e-2)


def test_bfloat16_is_near_float32():
    outputs, inputs, table = scene(200, 300)
    felt, conv = felt_by(outputs, inputs, table), KPConv(16, 16, 15)
    features = torch.randn(300, 16)
    wide, narrow = conv(features, felt), conv(features.bfloat16(), felt)
    assert narrow.dtype == torch.bfloat16
    assert float((wide - narrow.float()).norm() / wide.norm()) < 2e-2


@pytest.mark.usefixtures('engine')
@pytest.mark.parametrize('dtype', [torch.float32, torch.bfloat16, torch.float64])
def test_neighbour_maximum_and_its_gradient(dtype):
    _, _, table = scene(20, 400)
    assert (table[:, 0] < 400).all()
    generator = torch.Generator().manual_seed(3)
    order = torch.rand(400, 7, generator=generator).argsort(0)
    x = ((order - 200) / 50).sinh().to(dtype).requires_grad_()  # no two of a channel are equal
    assert all(len(channel.unique()) == 400 for channel in x.t())
    out = neighbor_max.neighbor_max(x, table)
    expected = torch.stack([x[row[row < 400].long()].amax(0) for row in table])
    torch.testing.assert_close(out, expected)
    weight = torch.randn(20, 7, generator=generator).to(dtype)
    (ours,) = torch.autograd.grad((out * weight).sum(), x)
    (theirs,) = torch.autograd.grad((expected * weight).sum(), x)
    ulps = {torch.bfloat16: (3e-2, 2**-6)}
    atol, rtol = ulps.get(dtype, (1e-5, 0))  # sums of a few numbers, rounded in another order
    torch.testing.assert_close(ours, theirs, atol=atol, rtol=rtol)


def test_neighbour_maximum_refuses_a_point_without_any():
    with pytest.raises(ValueError, match='no neighbour'):
        neighbor_max.neighbor_max(torch.ones(2, 3), torch.tensor([[2, 2]], dtype=torch.int32))


@pytest.mark.parametrize('count', [1, 2, 15])
def test_kernel_points_are_spread_and_repeatable(count):
    points = kernel_points(count)
    assert not points[0].any()
    assert np.array_equal(points, kernel_points.__wrapped__(count))
    if count > 1:
        assert np.linalg.norm(points[1:], axis=1).mean() == pytest.approx(1.0)
    if count == 15:  # the best known spread of 14 points on a sphere leaves 0.933 between two
        gaps = np.linalg.norm(points[:, None] - points[None], axis=2) + 9 * np.eye(count)
        assert gaps.min() > 0.85
        assert np.linalg.norm(points.mean(0)) < 0.02
