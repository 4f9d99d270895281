import numpy as np
import pytest
import torch

from gcl_core.errors import GclError
from gcl_core.ops import ground
from gcl_core.ops import voxelize as voxelize_module
from gcl_core.ops.ground import height_above_ground
from gcl_core.ops.native.voxelize import group_points
from gcl_core.ops.voxelize import coarsen, encode, refine, voxelize
from gcl_core.types import PointCloud


def test_points_of_one_voxel_become_their_barycentre():
    points = np.array([[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [-0.1, 0.1, 0.1]], np.float32)
    voxels = voxelize([PointCloud(points)], voxel_size=0.3, max_range=10.0)
    expected = torch.tensor([[-0.1, 0.1, 0.1], [0.15, 0.1, 0.1]])
    torch.testing.assert_close(voxels.points, expected)
    assert voxels.splits == (0, 2)


def test_scans_of_a_batch_stay_apart():
    cloud = PointCloud(np.zeros((1, 3), np.float32))
    voxels = voxelize([cloud, cloud], voxel_size=0.3, max_range=10.0)
    assert voxels.splits == (0, 1, 2)
    assert (voxels.keys >> 48).tolist() == [0, 1]


@pytest.mark.parametrize('coords', [[-3, 5, 0], [-4, -1, 7], [0, 0, 0]])
def test_coarse_voxel_is_the_floor_of_half(coords):
    c = torch.tensor([coords])
    # The bias of encode is halved along with the coordinate; compare with a reference voxel.
    origin = int(coarsen(encode(torch.zeros(1, 3, dtype=torch.long))))
    half = torch.div(c, 2, rounding_mode='floor')
    shift = int(half[0, 0] << 32) + int(half[0, 1] << 16) + int(half[0, 2])
    assert int(coarsen(encode(c))) == origin + shift


def test_refine_undoes_coarsen_for_even_voxels():
    key = encode(torch.tensor([[-4, 6, 2]])) + (5 << 48)
    assert torch.equal(refine(coarsen(key)), key)


def test_nothing_in_range_names_the_remedy():
    far = PointCloud(np.full((2, 3), 500.0, np.float32))
    with pytest.raises(GclError, match='within 80 m'):
        voxelize([far], voxel_size=0.3, max_range=80.0)


def test_height_above_ground_follows_the_slope_and_ignores_a_ghost():
    x, y = np.meshgrid(np.arange(-20, 20, 0.25), np.arange(-20, 20, 0.25))
    ground = np.stack([x, y, 0.02 * x], -1).reshape(-1, 3).astype(np.float32)
    extra = np.array([[10.0, 0.0, 3.2], [10.0, 0.0, -9.0]], np.float32)
    points = torch.from_numpy(np.concatenate([ground, extra]))
    height = height_above_ground(points, torch.zeros(len(points), dtype=torch.long))
    assert float(height[-2]) == pytest.approx(3.0, abs=0.25)
    assert float(height[:-2].max()) < 0.3


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('count', [1, 500, 20000])
def test_compiled_heights_are_torchs(count):
    generator = torch.Generator().manual_seed(9)
    points = torch.randn(count, 3, generator=generator) * torch.tensor([40.0, 40.0, 4.0])
    points[: count // 2, :2] /= 10  # cells of many points, whose lowest are ghosts
    scan = torch.randint(3, (count,), generator=generator)
    assert torch.equal(height_above_ground(points, scan), ground._above(points, scan))


@pytest.mark.usefixtures('compiled')
def test_height_of_a_point_off_the_grid_is_refused():
    with pytest.raises(GclError, match='50000 voxels'):
        height_above_ground(torch.tensor([[2e5, 0.0, 0.0]]), torch.tensor([0]))


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('count', [0, 1, 5000])
def test_compiled_voxels_are_torchs(count):
    generator = torch.Generator().manual_seed(8)
    points = 40 * torch.randn(count, 3, generator=generator)
    limits = {'voxel_size': 0.7, 'max_range': 80.0}
    ours = group_points(points, **limits, axis_bits=16, limit=1000)
    keys, mean = voxelize_module._grouped(points, **limits)
    assert torch.equal(ours[0], keys)
    torch.testing.assert_close(ours[1], mean)


def test_a_voxel_off_the_grid_is_named():
    far = PointCloud(np.array([[0.0, 0.0, 0.0], [9000.0, 0.0, 0.0]], np.float32))
    with pytest.raises(GclError, match='90000 voxels'):
        voxelize([far], voxel_size=0.1, max_range=2e4)
