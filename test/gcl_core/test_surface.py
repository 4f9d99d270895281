"""What a scan says of the space around it: the compiled kernels against their definitions."""

import math

import pytest
import torch

from gcl_core.estimation import surface
from gcl_core.matching import keypoints
from gcl_core.ops.native.spread import spread_rows


def scattered(count, seed=0):
    """Points all around, up to the borders of the grids and beyond; some on the axes."""
    generator = torch.Generator().manual_seed(seed)
    scale = torch.tensor([40.0, 40.0, 6.0])
    points = scale * torch.randn(count, 3, generator=generator)
    on_grid = torch.randint(-3, 4, (count // 5, 3), generator=generator).float()
    points[: len(on_grid)] = on_grid * torch.tensor([1.0, -1.0, 0.5])
    return points


def same(ours, theirs):
    torch.testing.assert_close(ours, theirs, atol=0, rtol=0, equal_nan=True)


def test_a_cell_is_that_of_its_angles():
    points = scattered(20_000).t()
    cell, distance, inside = surface.direction_cell(points)
    x, y, z = points.double()
    column = (torch.atan2(y, x) + math.pi) / surface.AZIMUTH
    row = (torch.atan2(z, (x * x + y * y).sqrt()) - surface.LOWEST) / surface.ELEVATION
    torch.testing.assert_close(distance, points.double().norm(dim=0).float())
    clear = ((row - row.round()).abs() > 1e-5) & ((column - column.round()).abs() > 1e-5)
    assert int(clear.sum()) > 15_000
    assert torch.equal(inside[clear], ((row >= 0) & (row < surface.ROWS))[clear])
    expected = row.floor().long() * surface.COLUMNS + column.floor().long()
    assert torch.equal(cell[clear & inside], expected[clear & inside])


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('count', [0, 1, 127, 20_000])
def test_compiled_range_image_is_torchs(count):
    points = scattered(count)
    same(surface._range_image(points), surface._image_of(points))


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('count', [0, 1, 5000])
def test_compiled_grids_are_torchs(count):
    points = scattered(count)
    same(surface._occupancy(points), surface._occupied_by(points))
    same(surface._ground_grid(points), surface._mean_heights(points))


@pytest.mark.usefixtures('compiled')
def test_range_image_does_not_depend_on_threads():
    points, threads, found = scattered(20_000), torch.get_num_threads(), []
    try:
        for count in (1, 2, 3, 5):
            torch.set_num_threads(count)
            found.append(surface._range_image(points))
    finally:
        torch.set_num_threads(threads)
    for other in found:
        same(other, found[0])


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize(('count', 'limit'), [(2, 1), (300, 299), (5000, 1), (5000, 2000)])
def test_compiled_choice_of_points_is_torchs(count, limit):
    points = scattered(count)
    order = torch.randperm(count, generator=torch.Generator().manual_seed(1))
    ours = spread_rows(points, order, size=keypoints.CELL, limit=limit)
    assert torch.equal(ours, keypoints._in_turn(points, order, limit))


def test_points_too_far_apart_are_chosen_by_torch():
    points = scattered(50) * 1e4
    assert len(keypoints.spread(points, 20)) == 20
