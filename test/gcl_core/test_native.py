"""The compiled kernels against the torch functions that define them."""

import pytest
import torch

from gcl_core.matching import nearest
from gcl_core.models.blocks import ConvNorm
from gcl_core.ops import kernel_map
from gcl_core.ops.native import kernel_map as compiled_maps
from gcl_core.ops.native import kernels
from gcl_core.ops.native.nearest import nearest_rows
from gcl_core.ops.sparse_conv import gather_matmul, gather_weight_grad, sparse_conv
from gcl_core.ops.voxelize import coarsen, encode, refine

pytestmark = pytest.mark.usefixtures('compiled')
TOLERANCE = {torch.float32: 1e-5, torch.bfloat16: 1e-2}
CHANNELS = [
    (1, 32),
    (2, 32),
    (3, 5),
    (32, 64),
    (48, 48),
    (7, 80),
    (96, 100),
]  # in vectors: odd, even


def random_map(side: int = 14) -> kernel_map.KernelMap:
    generator = torch.Generator().manual_seed(3)
    coords = (torch.rand(side, side, side, generator=generator) < 0.2).nonzero()
    return kernel_map.same_map(encode(coords - side // 2), kernel_map.CUBE_3)


def down_map_of(fine: torch.Tensor) -> kernel_map.KernelMap:
    return kernel_map.down_map(fine, coarsen(fine).unique())


def engine_of(dtype: torch.dtype) -> kernels.Kernels:
    found = kernels.kernels_for(torch.empty(0, dtype=dtype))
    assert found is not None
    return found


def relative(a: torch.Tensor, b: torch.Tensor) -> float:
    return float((a.float() - b.float()).norm() / b.float().norm())


@pytest.mark.parametrize('dtype', TOLERANCE)
@pytest.mark.parametrize(('c_in', 'c_out'), CHANNELS)
def test_convolution_and_weight_gradient(dtype, c_in, c_out):
    kmap, engine = random_map(), engine_of(dtype)
    generator = torch.Generator().manual_seed(4)
    x = torch.randn(kmap.num_inputs, c_in, generator=generator).to(dtype)
    grad = torch.randn(kmap.num_outputs, c_out, generator=generator).to(dtype)
    weight = torch.randn(27, c_in, c_out, generator=generator)
    ours = engine.convolve(x, kmap.neighbors, engine.pack(weight))
    assert relative(ours, gather_matmul(x, kmap.neighbors, weight)) < TOLERANCE[dtype]
    back = engine.convolve(grad, kmap.inverse, engine.pack(weight, transposed=True))
    transposed = gather_matmul(grad, kmap.inverse, weight.transpose(1, 2))
    assert relative(back, transposed) < TOLERANCE[dtype]
    of_weight = engine.weight_grad(x, kmap.neighbors, grad)
    assert relative(of_weight, gather_weight_grad(x, kmap.neighbors, grad)) < TOLERANCE[dtype]


@pytest.mark.parametrize('dtype', TOLERANCE)
def test_folded_block_equals_its_parts(dtype):
    kmap = random_map()
    block = ConvNorm(8, 40).train()
    x = torch.randn(kmap.num_inputs, 8, generator=torch.Generator().manual_seed(5))
    for _ in range(3):
        block(x, kmap)  # gives the norm statistics other than 0 and 1
    block.eval()
    residual = torch.randn(kmap.num_outputs, 40).to(dtype)
    parts = block(x.to(dtype), kmap, residual).detach()
    with torch.inference_mode():
        folded = block(x.to(dtype), kmap, residual)
    assert relative(folded, parts) < 2 * TOLERANCE[dtype]


def test_folded_weights_are_forgotten_when_training_goes_on():
    kmap, block = random_map(), ConvNorm(4, 4).eval()
    x = torch.randn(kmap.num_inputs, 4)
    with torch.no_grad():
        before = block(x, kmap)
        block.train()
        block.conv.weight.mul_(3)
        after = block.eval()(x, kmap)
    torch.testing.assert_close(after, 3 * before)


def some_keys() -> torch.Tensor:
    """Two scans with walls, whose voxels stand one upon the other."""
    generator = torch.Generator().manual_seed(6)
    loose = torch.randint(-30, 30, (4000, 3), generator=generator)
    wall = torch.cartesian_prod(torch.tensor([-7, 11]), torch.arange(-9, 9), torch.arange(-5, 12))
    keys = encode(torch.cat([loose, wall[torch.rand(len(wall), generator=generator) < 0.8]]))
    return torch.cat([keys.unique() + (scan << 48) for scan in (0, 1)])


@pytest.mark.parametrize(('edge', 'height'), [(3, 3), (5, 5), (5, 3), (2, 2), (4, 4), (1, 1)])
def test_maps(edge, height):
    fine = some_keys()
    corners = refine(coarsen(fine).unique())
    shape = kernel_map.KernelShape(edge, height)
    for centres in (fine, corners, fine[:0]):
        rows = kernel_map.search(fine, centres, shape)
        found = compiled_maps.search(
            fine, centres, (edge, height), axis_bits=16, with_inverse=True
        )
        assert found is not None
        assert torch.equal(found[0], rows)
        assert torch.equal(found[1], kernel_map.invert(rows, len(fine)))
    for keys in (fine, fine[:1], fine[:0]):
        found = compiled_maps.search_same(keys, (edge, height), axis_bits=16)
        assert (found is None) == (edge % 2 == 0)
        assert found is None or torch.equal(found, kernel_map.search(keys, keys, shape))


def test_halving():
    for fine in (some_keys(), some_keys()[:1], some_keys()[:0]):
        coarse, parent = torch.unique(coarsen(fine), return_inverse=True)
        found = compiled_maps.unique(coarsen(fine), axis_bits=16)
        assert found is not None
        assert torch.equal(found[0], coarse)
        assert torch.equal(found[1], parent)
        centres = refine(coarse) + kernel_map.UPPER_CORNER
        rows = kernel_map.search(fine, centres, kernel_map.KernelShape.cube(2))
        table = compiled_maps.halving_map(fine, parent, len(coarse), axis_bits=16)
        assert table is not None
        assert torch.equal(table[0], rows)
        assert torch.equal(table[1], kernel_map.invert(rows, len(fine)))


def test_voxels_too_far_apart_to_be_sorted_are_left_to_torch():
    corner = encode(torch.tensor([[-30000] * 3, [30000] * 3]))
    assert compiled_maps.unique(torch.cat([corner, corner + (1 << 48)]), axis_bits=16) is None
    assert kernel_map.halved(corner)[1].tolist() == [0, 1]


@pytest.mark.parametrize('dtype', TOLERANCE)
def test_number_of_threads_does_not_change_a_bit(dtype):
    kmap = random_map(side=24)
    x = torch.randn(kmap.num_inputs, 16).to(dtype).requires_grad_()
    weight = torch.randn(27, 16, 16, requires_grad=True)
    results, threads = [], torch.get_num_threads()
    try:
        for count in (1, 2, 2, 3):
            torch.set_num_threads(count)
            out = sparse_conv(x, weight, kmap)
            maps = random_map(side=24), down_map_of(some_keys())
            tables = [table for made in maps for table in (made.neighbors, made.inverse)]
            results.append((out, *torch.autograd.grad(out.sum(), (x, weight)), *tables))
    finally:
        torch.set_num_threads(threads)
    assert all(torch.equal(a, b) for other in results for a, b in zip(results[0], other))


@pytest.mark.parametrize('dtype', TOLERANCE)
@pytest.mark.parametrize('shape', [(1, 1, 3), (5, 300, 32), (700, 65, 7), (300, 700, 16)])
def test_nearest_rows(dtype, shape):
    n, m, length = shape
    generator = torch.Generator().manual_seed(7)
    source, target = (torch.randn(k, length, generator=generator).to(dtype) for k in (n, m))
    ours, torchs = nearest_rows(source, target), nearest._by_chunks(source, target)
    assert ours is not None
    assert torch.equal(ours[1], torchs[1])
    torch.testing.assert_close((ours[0], ours[2]), (torchs[0], torchs[2]))
    threads = torch.get_num_threads()
    try:
        torch.set_num_threads(threads + 1)
        again = nearest_rows(source, target)
    finally:
        torch.set_num_threads(threads)
    assert all(torch.equal(a, b) for a, b in zip(ours, again))


def test_the_first_of_equals_is_nearest_and_all_may_be_unlike():
    target = torch.tensor([[0.0, 1.0]]).repeat(100, 1)
    value, column, best = nearest_rows(torch.tensor([[1.0, -2.0]]), target)
    assert (float(value), int(column)) == (-2.0, 0)
    assert torch.equal(best, torch.full((100,), -2.0))


def test_misfitting_input_is_refused():
    kmap, engine = random_map(), engine_of(torch.float32)
    weight = engine.pack(torch.randn(27, 4, 4))
    with pytest.raises(TypeError, match='float64'):
        engine.convolve(torch.zeros(3, 4, dtype=torch.float64), kmap.neighbors, weight)
    with pytest.raises(ValueError, match='8 channels'):
        engine.convolve(torch.zeros(3, 8), kmap.neighbors, weight)
    with pytest.raises(TypeError, match='contiguous'):
        engine.convolve(torch.zeros(3, 4), kmap.neighbors.t().contiguous().t(), weight)
