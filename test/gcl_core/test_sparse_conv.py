"""Sparse convolution against torch's dense conv3d, forward and backward."""

import pytest
import torch

from gcl_core.ops.kernel_map import CUBE_3, KernelShape, build_pyramid, down_map, same_map
from gcl_core.ops.sparse_conv import sparse_conv
from gcl_core.ops.voxelize import coarsen, encode

SIDE = 8


@pytest.fixture
def coords() -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    occupied = torch.rand(SIDE, SIDE, SIDE, generator=generator) < 0.3
    return occupied.nonzero()


def dense(x: torch.Tensor, coords: torch.Tensor) -> torch.Tensor:
    grid = x.new_zeros(SIDE, SIDE, SIDE, x.shape[1])
    return grid.index_put(tuple(coords.t()), x).permute(3, 0, 1, 2).unsqueeze(0)


def conv3d_weight(weight: torch.Tensor, kernel: int) -> torch.Tensor:
    return weight.reshape(kernel, kernel, kernel, *weight.shape[1:]).permute(4, 3, 0, 1, 2)


def compare(ours, reference, x, weight):
    torch.testing.assert_close(ours, reference)
    probe = torch.randn(ours.shape, generator=torch.Generator().manual_seed(1), dtype=ours.dtype)
    for a, b in zip(
        torch.autograd.grad((ours * probe).sum(), (x, weight)),
        torch.autograd.grad((reference * probe).sum(), (x, weight)),
        strict=True,
    ):
        torch.testing.assert_close(a, b)


def tensors(n: int, kernel: int, dtype: torch.dtype = torch.float64):
    generator = torch.Generator().manual_seed(2)
    x = torch.randn(n, 3, generator=generator, dtype=dtype, requires_grad=True)
    weight = torch.randn(kernel**3, 3, 5, generator=generator, dtype=dtype, requires_grad=True)
    return x, weight


@pytest.mark.parametrize('kernel', [3, 5])
def test_stride_one_equals_conv3d(coords, kernel):
    x, weight = tensors(len(coords), kernel)
    ours = sparse_conv(x, weight, same_map(encode(coords), KernelShape.cube(kernel)))
    full = torch.nn.functional.conv3d(
        dense(x, coords), conv3d_weight(weight, kernel), padding=kernel // 2
    )
    compare(ours, full[0][:, coords[:, 0], coords[:, 1], coords[:, 2]].t(), x, weight)


def coarse_coords(coords: torch.Tensor) -> torch.Tensor:
    return torch.unique(torch.div(coords, 2, rounding_mode='floor'), dim=0)


@pytest.mark.parametrize('edge', [2, 3, 4])
def test_stride_two_equals_conv3d(coords, edge):
    x, weight = tensors(len(coords), edge)
    fine = encode(coords)
    coarse = coarse_coords(coords)
    ours = sparse_conv(x, weight, down_map(fine, coarsen(fine).unique(), edge))
    full = torch.nn.functional.conv3d(
        dense(x, coords), conv3d_weight(weight, edge), padding=(edge - 1) // 2, stride=2
    )
    compare(ours, full[0][:, coarse[:, 0], coarse[:, 1], coarse[:, 2]].t(), x, weight)


def test_transposed_equals_conv_transpose3d(coords):
    fine, coarse = encode(coords), coarse_coords(coords)
    x, weight = tensors(len(coarse), 3)
    ours = sparse_conv(x, weight, down_map(fine, coarsen(fine).unique()).transposed())
    grid = x.new_zeros(SIDE // 2, SIDE // 2, SIDE // 2, 3).index_put(tuple(coarse.t()), x)
    dense_weight = conv3d_weight(weight, 3).transpose(0, 1)
    full = torch.nn.functional.conv_transpose3d(
        grid.permute(3, 0, 1, 2).unsqueeze(0), dense_weight, stride=2, padding=1, output_padding=1
    )
    compare(ours, full[0][:, coords[:, 0], coords[:, 1], coords[:, 2]].t(), x, weight)


def test_bfloat16_is_close_to_float32(coords):
    x, weight = tensors(len(coords), 3, torch.float32)
    kmap = same_map(encode(coords), CUBE_3)
    exact = sparse_conv(x, weight, kmap)
    rough = sparse_conv(x.bfloat16(), weight, kmap)
    assert float((exact - rough.float()).detach().norm() / exact.detach().norm()) < 0.02


def test_no_voxels_and_lone_voxels():
    empty = same_map(encode(torch.empty(0, 3, dtype=torch.long)), CUBE_3)
    assert sparse_conv(torch.empty(0, 3), torch.ones(27, 3, 5), empty).shape == (0, 5)
    lone = same_map(encode(torch.tensor([[4, 4, 4]])), CUBE_3)
    weight = torch.arange(27.0).reshape(27, 1, 1)
    assert sparse_conv(torch.ones(1, 1), weight, lone).item() == 13.0  # the centre of 27


def test_scans_of_a_batch_do_not_touch():
    one = encode(torch.tensor([[0, 0, 0], [0, 0, 1]]))
    batch = torch.cat([one, one + (1 << 48)])
    neighbors = same_map(batch, CUBE_3).neighbors
    assert neighbors[:, :2].unique().tolist() == [0, 1, 4]
    assert neighbors[:, 2:].unique().tolist() == [2, 3, 4]


def test_pyramid_halves_level_by_level(coords):
    pyramid = build_pyramid(encode(coords), levels=4, stem=KernelShape.cube(5))
    assert [len(k) for k in pyramid.keys][-1] == 1
    for level, down in enumerate(pyramid.down):
        assert (down.num_inputs, down.num_outputs) == (
            len(pyramid.keys[level]),
            len(pyramid.keys[level + 1]),
        )


def test_gradients_in_float64(coords):
    kmap = down_map(encode(coords), coarsen(encode(coords)).unique())
    x, weight = tensors(len(coords), 3)
    assert torch.autograd.gradcheck(lambda x, w: sparse_conv(x, w, kmap), (x, weight))
