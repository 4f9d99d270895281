"""Features of a turned scan are those of the scan itself, their blocks rolled."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.models.backbone import QUARTER_TURNS
from gcl_core.models.kpconv_resunet import KPConvConfig
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.models.zoo import build
from gcl_core.ops.ground import height_above_ground
from gcl_core.ops.kernel_map import KernelShape, down_map, same_map
from gcl_core.ops.kernel_points import kernel_points, points_turned_back
from gcl_core.ops.quarter_turns import (
    TURNS,
    QuarterTurnConv,
    QuarterTurnNorm,
    expand,
    join_blocks,
    offsets_turned_back,
    roll_blocks,
)
from gcl_core.ops.sparse_conv import sparse_conv
from gcl_core.ops.voxelize import coarsen, encode, voxelize
from gcl_core.types import PointCloud

SMALL = ResUNetConfig(
    encoder=(8, 8, 16), decoder=(8,), head=8, descriptor=16, height_input=True,
    quarter_turns=True, block=(5, 3), stride_kernel=2,
)  # fmt: skip

SMALL_KPCONV = KPConvConfig(
    width=16, levels=3, output_level=1, descriptor=16, height_input=True,
    quarter_turns=True, radius=2.0, limits=(70, 70, 70),  # no neighbour is left out
)  # fmt: skip


def turned(points: np.ndarray) -> np.ndarray:
    """Turn points by 90 degrees about z, without rounding."""
    return np.stack([-points[:, 1], points[:, 0], points[:, 2]], 1)


def off_borders(size: float) -> PointCloud:
    """A simulated scan without the points that lie on a border between voxels."""
    points = SimulatedSequence(41).scan(90).points
    return PointCloud(points[(points[:, :2] / size % 1 != 0).all(1)])


def order(points: torch.Tensor) -> np.ndarray:
    return np.lexsort(points.numpy().T)


def random_keys(seed: int = 0) -> torch.Tensor:
    """Voxel coordinates on both sides of the origin."""
    generator = torch.Generator().manual_seed(seed)
    return (torch.rand(9, 9, 5, generator=generator) < 0.4).nonzero() - 4


@pytest.mark.parametrize('turns', range(TURNS))
def test_rolling_four_times_changes_nothing(turns):
    features = torch.arange(24.0).reshape(2, 12)
    assert torch.equal(roll_blocks(roll_blocks(features, turns), TURNS - turns), features)
    assert roll_blocks(features, 1)[0, :3].tolist() == [9.0, 10.0, 11.0]


def test_blocks_stay_blocks_when_features_are_joined():
    a, b = torch.arange(8.0).reshape(1, 8), 100 + torch.arange(4.0).reshape(1, 4)
    joined = join_blocks(a, b)
    assert joined.tolist() == [[0, 1, 100, 2, 3, 101, 4, 5, 102, 6, 7, 103]]
    rolled = join_blocks(roll_blocks(a, 1), roll_blocks(b, 1))
    assert torch.equal(rolled, roll_blocks(joined, 1))


@pytest.mark.parametrize('shape', [KernelShape(5, 3), KernelShape.cube(3), KernelShape.cube(1)])
@pytest.mark.parametrize('lifts', [True, False])
def test_convolution_of_turned_voxels(shape, lifts):
    coords = random_keys()
    turned_coords = torch.stack([-coords[:, 1] - 1, coords[:, 0], coords[:, 2]], 1)
    keys, turned_keys = encode(coords), encode(turned_coords)
    row, turned_row = keys.argsort(), turned_keys.argsort()
    layer = QuarterTurnConv(3 if lifts else 8, 12, shape, lifts=lifts).double()
    x = torch.randn(len(coords), 3 if lifts else 8, dtype=torch.float64)
    turned_x = x if lifts else roll_blocks(x, 1)
    out = layer(x[row], same_map(keys[row], shape))
    turned_out = layer(turned_x[turned_row], same_map(turned_keys[turned_row], shape))
    back = turned_row.argsort()[row]
    torch.testing.assert_close(turned_out[back], roll_blocks(out, 1))


def test_what_was_described_with_can_be_trained():
    offsets_turned_back.cache_clear()
    shape, keys = KernelShape(5, 3), encode(random_keys()).sort().values
    layer, x = QuarterTurnConv(8, 12, shape), torch.randn(len(keys), 8)
    with torch.inference_mode():
        layer(x, same_map(keys, shape))
    layer(x, same_map(keys, shape)).sum().backward()
    assert layer.filters.grad is not None


@pytest.mark.parametrize('edge', [2, 4])
def test_strided_convolution_of_turned_voxels(edge):
    coords = random_keys(1)
    turned_coords = torch.stack([-coords[:, 1] - 1, coords[:, 0], coords[:, 2]], 1)
    outs = []
    layer = QuarterTurnConv(8, 12, KernelShape.cube(edge)).double()
    x = torch.randn(len(coords), 8, dtype=torch.float64)
    for places, features in ((coords, x), (turned_coords, roll_blocks(x, 1))):
        keys = encode(places)
        row = keys.argsort()
        coarse = coarsen(keys[row]).unique()
        kmap = down_map(keys[row], coarse, edge)
        down = layer(features[row], kmap)
        outs.append(
            (
                coarse,
                down,
                sparse_conv(down[:, :4], layer.weight[:, :4], kmap.transposed())[row.argsort()],
            )
        )
    (coarse, down, up), (turned_coarse, turned_down, _) = outs
    xyz = [
        torch.stack([keys >> 32, keys >> 16 & 0xFFFF, keys & 0xFFFF], 1)
        for keys in (coarse, turned_coarse)
    ]
    half = 1 << 14  # coarse coordinates are biased by half of what fine ones are
    expected = torch.stack([2 * half - xyz[0][:, 1] - 1, xyz[0][:, 0], xyz[0][:, 2]], 1)
    match = (expected[:, None] == xyz[1][None]).all(2).int().argmax(1)
    torch.testing.assert_close(turned_down[match], roll_blocks(down, 1))
    assert up.shape == (len(coords), 12)


def test_gradient_of_the_expansion():
    shape = KernelShape(3, 1)
    filters = torch.randn(shape.offsets, TURNS, 2, 1, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda f: expand(f, offsets_turned_back(shape)), filters)


def test_norm_shares_its_statistics_over_the_blocks():
    norm = QuarterTurnNorm(8, momentum=0.1)
    x = torch.randn(50, 8) * torch.arange(1.0, 9.0)
    torch.testing.assert_close(norm(roll_blocks(x, 1)), roll_blocks(norm(x), 1))
    assert norm.running_mean.shape == (2,)


def test_voxels_and_heights_of_a_turned_scan_have_the_same_bits():
    cloud = off_borders(0.3)
    sides = []
    for scan in (PointCloud(turned(cloud.points)), cloud):
        voxels = voxelize([scan], voxel_size=0.3, max_range=80.0)
        height = height_above_ground(voxels.points, voxels.keys >> 48)
        sides.append((voxels.points, height))
    (points, height), (expected, expected_height) = sides
    expected = torch.from_numpy(turned(expected.numpy()))
    rows = order(points), order(expected)
    assert torch.equal(points[rows[0]], expected[rows[1]])
    assert torch.equal(height[rows[0]], expected_height[rows[1]])


@pytest.mark.parametrize('config', [SMALL, SMALL_KPCONV], ids=['conv', 'kpconv'])
def test_descriptors_of_a_turned_scan_are_rolled(config):
    torch.manual_seed(4)
    model, cloud = build(config).eval(), off_borders(0.3)
    seen = model.describe([cloud])[0]
    again = model.describe([PointCloud(turned(cloud.points))])[0]
    expected = torch.from_numpy(turned(seen.points.numpy()))
    rows = order(again.points), order(expected)
    assert torch.equal(again.points[rows[0]], expected[rows[1]])
    rolled = roll_blocks(seen.descriptors, 1)[rows[1]]
    torch.testing.assert_close(again.descriptors[rows[0]], rolled, atol=1e-5, rtol=0)
    assert not torch.allclose(again.descriptors[rows[0]], seen.descriptors[rows[1]], atol=1e-2)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'stride_kernel': 3}, 'must be even'),
        ({'encoder': (8, 10, 16)}, r'\[10\] are no multiples of 4'),
        ({'block': (4, 3)}, 'must be odd'),
        ({'stride_kernel': 1}, 'take 2 or more'),
    ],
)
def test_shapes_that_quarter_turns_do_not_bear(change, words):
    with pytest.raises(GclError, match=words):
        replace(SMALL, **change)


@pytest.mark.parametrize('config', [SMALL, SMALL_KPCONV], ids=['conv', 'kpconv'])
def test_one_description_serves_all_quarter_turns(config, monkeypatch):
    torch.manual_seed(4)
    model, cloud = build(config).eval(), off_borders(0.3)
    calls, describe = [], model.describe_prepared
    monkeypatch.setattr(model, 'describe_prepared', lambda i: calls.append(1) or describe(i))
    every = model.describe_headings(cloud)
    assert len(calls) == 1
    for quarters in range(TURNS):
        points = cloud.points
        for _ in range(quarters):
            points = turned(points)
        (own,), found = model.describe([PointCloud(points)]), every[quarters].features
        moved = torch.from_numpy(se3.transform(QUARTER_TURNS[quarters], found.points.numpy()))
        rows = order(own.points), order(moved)
        assert torch.equal(own.points[rows[0]], moved[rows[1]])
        torch.testing.assert_close(
            own.descriptors[rows[0]], found.descriptors[rows[1]], atol=1e-5, rtol=0
        )


def test_kernel_points_in_orbits_are_turned_to_each_other():
    points = kernel_points(15, in_orbits=True)
    assert np.linalg.norm(points[1:], axis=1).mean() == pytest.approx(1.0)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2) + np.eye(15)
    assert apart.min() > 0.5
    for quarters, rows in enumerate(points_turned_back(15, TURNS)):
        moved = points
        for _ in range(quarters):
            moved = turned(moved)
        np.testing.assert_allclose(points, moved[rows], atol=1e-9)
