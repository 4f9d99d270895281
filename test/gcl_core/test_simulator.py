"""The simulator: what the same seed gives, and whether clouds, poses and clocks agree."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gcl_core import se3
from gcl_core.data.simulator.casting import Hits
from gcl_core.data.simulator.kinds import KINDS
from gcl_core.data.simulator.meeting import meet
from gcl_core.data.simulator.returns import MIXED, Conditions, draw_conditions, measure
from gcl_core.data.simulator.sensors import SENSORS, sensor_named
from gcl_core.data.simulator.sequence import SimulatedSequence, World
from gcl_core.errors import GclError

DIGEST = """
import hashlib
from gcl_core.data.simulator.sequence import SimulatedSequence
drive = SimulatedSequence(17, sensor='vlp16')
print(hashlib.sha256(drive.scan(90).points.tobytes()).hexdigest())
"""


@pytest.fixture(scope='module')
def world():
    return World(17)


def ideal(beams, deskew=1.0):
    return Conditions(np.zeros(beams, np.float32), 0.0, 0.0, None, deskew)


def apart(drive, source, target):
    """Distance of each source point, moved by the poses, to the nearest target point."""
    T = se3.inverse(drive.T_world_lidar(target)) @ drive.T_world_lidar(source)
    points = drive.scan(source).points
    points = points[np.linalg.norm(points, axis=1) < 12.0][::7]
    return cKDTree(drive.scan(target).points).query(se3.transform(T, points))[0]


def test_another_process_makes_the_same_scan():
    drive = SimulatedSequence(17, sensor='vlp16')
    own = hashlib.sha256(drive.scan(90).points.tobytes()).hexdigest()
    other = subprocess.run(
        [sys.executable, '-c', DIGEST], capture_output=True, text=True, check=True
    )
    assert other.stdout.strip() == own


def test_scans_do_not_depend_on_what_was_read_before(world):
    first = SimulatedSequence(17, sensor='vlp16', world=world)
    first.scan(10)
    second = SimulatedSequence(17, sensor='vlp16', world=world)
    np.testing.assert_array_equal(first.scan(80).points, second.scan(80).points)


def test_scans_of_a_static_world_overlap_to_the_noise(world):
    drive = SimulatedSequence(17, world=world, moving=False, conditions=ideal(64))
    still = apart(drive, 91, 90)
    assert np.median(still) < 0.06
    assert np.quantile(still, 0.9) < 0.2


def test_raw_motion_bends_a_scan_and_deskewing_undoes_it(world):
    raw, deskewed = (
        SimulatedSequence(17, world=world, moving=False, conditions=ideal(64, share))
        for share in (0.0, 1.0)
    )
    behind = raw.scan(90).points, deskewed.scan(90).points
    shift = behind[0][-2000:] - behind[1][-2000:]
    speed = raw._drive.twist[90, 0]
    # The same beams were cast: at the sweep's end the vehicle is half a sweep further.
    assert len(behind[0]) == len(behind[1])
    assert np.abs(shift[:, 0]).max() == pytest.approx(0.05 * speed, rel=0.3)


@pytest.mark.parametrize('name', SENSORS)
def test_every_sensor_sees_within_its_field_and_range(world, name):
    sensor = sensor_named(name)
    points = SimulatedSequence(17, sensor=name, world=world).scan(60).points
    distance = np.linalg.norm(points, axis=1)
    assert len(points) > 0.3 * len(sensor.elevation_deg) * sensor.columns
    assert distance.max() < sensor.max_range + 1.0
    azimuth = np.rad2deg(np.arctan2(points[:, 1], points[:, 0]))
    assert np.abs(azimuth).max() <= sensor.field_deg / 2 + 5.0
    assert np.isfinite(points).all()


@pytest.mark.parametrize('kind', KINDS)
def test_every_kind_of_place_can_be_driven_through(kind):
    drive = SimulatedSequence(5, sensor='vlp16', kind=kind, span=60.0)
    heights = []
    for index in (0, 30, 60):
        points = drive.scan(index).points
        assert len(points) > 3000
        near = points[np.linalg.norm(points[:, :2], axis=1) < 8.0]
        heights.append(-np.quantile(near[:, 2], 0.1))
    assert 1.2 < np.median(heights) < 2.6


@pytest.mark.parametrize('manoeuvre', ['oncoming', 'following', 'crossing', 'turning'])
def test_two_vehicles_meet_in_one_world_by_one_clock(manoeuvre):
    first, second = meet(62, manoeuvre, sensors=('vlp16', 'solid120'))
    assert first.world is second.world
    assert len(first) == len(second)
    gaps, bearings = [], []
    for i in range(0, len(first), 10):
        assert first.stamp(i) == pytest.approx(second.stamp(i))
        T = se3.inverse(first.T_world_lidar(i)) @ second.T_world_lidar(i)
        gaps.append(np.linalg.norm(T[:3, 3]))
        bearings.append(abs(np.rad2deg(se3.yaw(T))))
    if manoeuvre == 'oncoming':
        assert min(gaps) < 12.0 < 80.0 < max(gaps)
        assert min(bearings) > 90.0
    elif manoeuvre == 'following':
        assert np.ptp(gaps) < 8.0
    else:
        assert min(gaps) < 45.0
        assert max(bearings) > 60.0


def test_each_vehicle_sees_the_other():
    """With the other vehicle there are returns where it stands, without it there are none."""
    first, second = meet(64, 'following', sensors=('hdl64e', 'vlp16'))
    assert second.others == (first,)
    index = len(first) // 2
    T = se3.inverse(second.T_world_lidar(index)) @ first.T_world_lidar(index)

    def near_other():
        points = se3.transform(T, first.scan(index).points)
        body = (np.abs(points[:, :2]) < [2.0, 0.8]).all(1) & (points[:, 2] > -1.2)
        return body.sum()

    count = near_other()
    first.others = ()
    without = near_other()
    assert count > without + 20


def test_traffic_moves_between_scans_and_keeps_clear(world):
    traffic = world.traffic
    here = np.zeros((1, 3))
    before = traffic.at(0.0, here + 1e3, crossing=False)
    assert len(before.soup) == 0  # nobody within 90 m of a place far away
    now, later = (traffic.at(t, here, crossing=False) for t in (0.0, 1.0))
    both = np.intersect1d(now.owner, later.owner)
    moved = 0
    for owner in both:
        a, b = (m.soup.triangles[m.owner == owner].mean((0, 1)) for m in (now, later))
        speed = np.linalg.norm(now.velocity[owner])
        assert np.linalg.norm((b - a)[:2]) == pytest.approx(speed, rel=0.25, abs=0.2)
        moved += speed > 2.0
    assert moved


def test_conditions_vary_between_seeds():
    drawn = [
        draw_conditions(sensor_named('vlp16'), np.random.default_rng(seed)) for seed in range(200)
    ]
    assert 5 < sum(c.rain > 0 for c in drawn) < 40
    assert 20 < sum(c.blind is not None for c in drawn) < 70
    assert 10 < sum(c.deskew == 0 for c in drawn) < 50


@pytest.mark.parametrize('strength', [1.0, 0.5])
def test_weak_returns_at_an_edge_are_mixed_no_more_than_strong_ones(strength):
    sensor = SENSORS['hdl64e']
    shape = (len(sensor.elevation_deg), 2000)
    distance = np.tile([10.0, 11.0], (shape[0], shape[1] // 2)).astype(np.float32)
    weak = sensor.weak_return * (10.0 / sensor.max_range) ** 2 * strength
    hits = Hits(distance, *(np.full(shape, v, np.float32) for v in (1.0, weak, 0.0)))
    still = Conditions(np.zeros(shape[0], np.float32), 0.0, 0.0, None, 1.0)
    rng = np.random.default_rng(0)
    measured = measure(sensor, hits, np.zeros(shape[1], np.float32), still, rng)
    seen = measured[measured > 0]
    between = np.mean((seen > 10.2) & (seen < 10.8))
    assert between == pytest.approx(0.6 * MIXED, abs=0.02)


def test_rain_and_a_blind_sector_cost_returns(world):
    dry = ideal(64)
    counts = []
    for conditions in (
        dry,
        Conditions(dry.beam_bias, 0.0, 1.0, None, 1.0),
        Conditions(dry.beam_bias, 0.0, 0.0, (-0.5, 0.5), 1.0),
    ):
        scan = SimulatedSequence(17, world=world, conditions=conditions).scan(60)
        counts.append(len(scan))
    assert counts[1] < 0.97 * counts[0]
    assert counts[2] < 0.9 * counts[0]


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (lambda: World(1, 'moon'), "unknown world 'moon'"),
        (lambda: meet(62, 'reversing'), "unknown manoeuvre 'reversing'"),
        (lambda: SimulatedSequence(1, route='up').T_world_lidar(0), "unknown route 'up'"),
    ],
)
def test_unknown_names_are_refused(call, message):
    with pytest.raises(GclError, match=message):
        call()


def test_nothing_stands_in_the_lanes():
    """In this street a bend once put a far building around the oncoming lane."""
    street = SimulatedSequence(11, kind='mixed', route='oncoming', sensor='vlp16', moving=False)
    for index in range(60, 120, 4):
        away = np.linalg.norm(street.scan(index).points, axis=1)
        assert np.percentile(away, 90) > 9.0, index
