"""The direction of a street: a property of the place, whatever way the vehicle faces."""

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.ops import heading as heading_module
from gcl_core.ops.heading import CELL, GROUND_CELL, dominant_heading
from gcl_core.registrar import Registrar


def off(heading, expected):
    """Difference modulo a quarter turn, radians."""
    return abs(np.mod(heading - expected + np.pi / 4, np.pi / 2) - np.pi / 4)


def street(rng) -> np.ndarray:
    """Ground, and two walls along x."""
    ground = np.column_stack([rng.uniform(-40, 40, (4000, 2)), np.full(4000, -1.8)])
    walls = rng.uniform([-40, -1.8, 0], [40, 3.0, 1], (4000, 3))
    walls[:, 1:] = np.column_stack([np.where(walls[:, 2] > 0.5, 8.0, -9.0), walls[:, 1]])
    return np.concatenate([ground, walls]).astype(np.float32)


@pytest.mark.parametrize('yaw', [-3.0, -0.7, 0.0, 0.3, 0.78, 2.0])
def test_walls_give_the_direction(yaw):
    points = street(np.random.default_rng(0))
    heading = dominant_heading(se3.transform(se3.from_xyz_rpy(yaw=yaw), points))
    assert -np.pi / 4 <= heading < np.pi / 4
    assert off(heading, yaw) < np.deg2rad(1.0)


@pytest.mark.parametrize('yaw', [1.0, 2.5])
def test_it_turns_with_a_scan(drive, yaw):
    points = drive.scan(90).points
    turned = se3.transform(se3.from_xyz_rpy(yaw=yaw), points)
    assert off(dominant_heading(turned), dominant_heading(points) + yaw) < np.deg2rad(6.0)


def test_scans_of_a_street_agree(drive):
    headings = [
        dominant_heading(drive.scan(i).points) + se3.yaw(drive.T_world_lidar(i))
        for i in (80, 100, 120)
    ]
    assert max(off(h, headings[0]) for h in headings) < np.deg2rad(16.0)


@pytest.mark.parametrize('points', [np.zeros((0, 3)), np.ones((5, 3)), np.full((5, 3), 200.0)])
def test_what_has_no_direction_is_left_as_it_is(points):
    assert dominant_heading(points.astype(np.float32)) == 0.0


def off_borders(points: np.ndarray) -> np.ndarray:
    """What is in the same cells after a quarter turn."""
    whole = [points[:, :2] / np.float32(cell) % 1 == 0 for cell in (CELL, GROUND_CELL)]
    return points[~np.any(whole, axis=(0, 2))]


@pytest.mark.parametrize('scan', [0, 90])
def test_neither_a_quarter_turn_nor_the_order_of_points_changes_a_bit(drive, scan):
    points = off_borders(drive.scan(scan).points)
    turned = np.stack([-points[:, 1], points[:, 0], points[:, 2]], 1)
    shuffled = np.random.default_rng(1).permutation(points)
    heading = dominant_heading(points)
    assert heading != 0.0
    assert dominant_heading(turned) == heading
    assert dominant_heading(shuffled) == heading


@pytest.mark.usefixtures('compiled')
@pytest.mark.parametrize('scan', [None, 0, 90])
def test_compiled_votes_are_numpys(drive, scan, monkeypatch):
    points = drive.scan(scan).points if scan is not None else np.zeros((0, 3), np.float32)
    expected = dominant_heading(points)
    monkeypatch.setattr(heading_module, 'heading_votes', lambda *_, **__: None)
    assert dominant_heading(points) == expected
    assert (expected == 0.0) == (scan is None)


def test_a_view_is_turned_to_the_street(drive):
    registrar = Registrar()
    view = registrar.view(drive.scan(90))
    aligned = registrar.model.config.align
    turned = se3.transform(view.T_view_lidar, drive.scan(90).points)
    assert np.allclose(view.T_view_lidar, np.eye(4)) != aligned
    assert not aligned or off(dominant_heading(turned), 0.0) < np.deg2rad(2.0)
