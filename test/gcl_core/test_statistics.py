"""Statistics of scans on clouds whose counts are known."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.data.overlap import overlap
from gcl_core.errors import GclError
from gcl_core.evaluation.statistics import every, group_statistics, measure
from gcl_core.types import PointCloud


def plane(first: float, count: int) -> np.ndarray:
    """One point in the middle of each voxel of a square, its corner at x = `first`."""
    side = (np.arange(count) + 0.5) * 0.3
    x, y = np.meshgrid(first + side, side)
    return np.stack([x.ravel(), y.ravel(), np.full(count**2, 0.15)], 1).astype(np.float32)


def test_a_full_plane_has_nine_occupied_neighbours_inside():
    statistics = measure(PointCloud(plane(12.0, 20)))
    inside, edge, corner = 18 * 18 * 9, 4 * 18 * 6, 4 * 4
    assert statistics.mean_neighbors == pytest.approx((inside + edge + corner) / 400)
    assert statistics.voxels.sum() == statistics.points.sum() == 400


def test_rings_are_ten_metres_and_empty_ones_have_no_neighbours():
    points = np.array([[5, 0, 0], [5.01, 0, 0], [15, 0, 0], [300, 0, 0]], np.float32)
    statistics = measure(PointCloud(points))
    assert statistics.points.tolist() == [2, 1, 0, 0, 0, 0, 0, 0]
    assert statistics.voxels.tolist() == [1, 1, 0, 0, 0, 0, 0, 0]
    np.testing.assert_array_equal(np.isnan(statistics.neighbors), statistics.voxels == 0)


def test_overlap_counts_the_share_that_both_see():
    target, half = PointCloud(plane(0.0, 20)), PointCloud(plane(3.3, 20))
    same = overlap(source=target, target=target, T_target_source=np.eye(4))
    assert same == 1.0
    assert overlap(source=half, target=target, T_target_source=np.eye(4)) == pytest.approx(0.5)
    moved = se3.from_xyz_rpy(x=50.0)
    assert overlap(source=target, target=target, T_target_source=moved) == 0.0


def test_group_share_of_a_drive(drive):
    groups = group_statistics(drive, 90)
    assert groups.scans[0] == 90
    assert len(groups.scans) == 7
    assert 0.5 < groups.share < 1.0
    assert groups.mean_size > 2.0
    with pytest.raises(GclError, match='scans 0 to 180, not 900'):
        group_statistics(drive, 900)


def test_scans_are_spread_over_a_sequence(drive):
    assert every(drive, 3) == [0, 90, 180]
    assert every(drive, 1000) == list(range(181))
