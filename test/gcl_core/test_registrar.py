"""The shipped weights on streets they never saw, and on real scans where present."""

import numpy as np
import pytest
import torch

from gcl_core import se3
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.sequence import T_target_source
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.estimation.refine import RefineConfig, prepare
from gcl_core.estimation.surface import surface
from gcl_core.evaluation import metrics
from gcl_core.evaluation.agreement import agreeing
from gcl_core.models.backbone import QUARTER_TURNS
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import PointCloud
from gcl_core.view import View

WEIGHTS = ('gcl_conv', 'gcl_kpconv')


@pytest.fixture(scope='module', params=WEIGHTS)
def registrar(request) -> Registrar:
    return Registrar(RegistrarConfig(weights=request.param))


@pytest.fixture(scope='module', params=WEIGHTS)
def same_heading(request) -> Registrar:
    return Registrar(RegistrarConfig(weights=request.param, headings=1))


@pytest.mark.parametrize('yaw', [0.0, 1.0, np.pi])
def test_registers_simulated_scans_at_any_heading(registrar, drive, yaw):
    turn = se3.from_xyz_rpy(yaw=yaw)
    source = PointCloud(se3.transform(turn, drive.scan(102).points))
    result = registrar.register(source=source, target=drive.scan(90))
    T = T_target_source(drive, source=102, target=90) @ se3.inverse(turn)
    assert metrics.registered(result.T_target_source, T, metrics.STRICT)
    assert result.accepted
    assert {'describe', 'match', 'estimate', 'verify', 'refine', 'total'} == set(result.ms)


@pytest.mark.parametrize('quarters', [1, 2, 3])
def test_turning_the_source_turns_the_result_and_nothing_else(registrar, drive, quarters):
    turn = QUARTER_TURNS[quarters]
    plain = registrar.register(source=drive.scan(102), target=drive.scan(90))
    turned = registrar.register(source=drive.scan(102).moved(turn), target=drive.scan(90))
    T = plain.T_target_source @ se3.inverse(turn)
    np.testing.assert_allclose(turned.T_target_source, T, atol=5e-3)
    assert (turned.accepted, turned.headings) == (plain.accepted, plain.headings)
    assert turned.probability == pytest.approx(plain.probability, abs=5e-3)


def test_vehicles_that_face_the_same_way_are_not_looked_at_otherwise(same_heading, drive):
    for yaw, found in ((0.2, True), (2.0, False)):
        turn = se3.from_xyz_rpy(yaw=yaw)
        T = T_target_source(drive, source=102, target=90) @ se3.inverse(turn)
        result = same_heading.register(source=drive.scan(102).moved(turn), target=drive.scan(90))
        assert (result.accepted, result.headings) == (found, 1)
        assert metrics.registered(result.T_target_source, T, metrics.STRICT) == found


def test_registers_real_scans(same_heading, real_root):
    sequence = KittiSequence(real_root, '80')
    result = same_heading.register(source=sequence.scan(8), target=sequence.scan(0))
    assert metrics.registered(
        result.T_target_source, T_target_source(sequence, source=8, target=0), metrics.STRICT
    )


def test_what_is_farther_than_wanted_is_left_out(drive):
    near = Registrar(RegistrarConfig(headings=1, max_distance=10.0))
    assert near.register(source=drive.scan(98), target=drive.scan(90)).accepted
    result = near.register(source=drive.scan(110), target=drive.scan(90))
    assert not result.accepted
    T = result.T_target_source
    assert T is None or np.linalg.norm(T[:3, 3]) < 10 + near.config.refine.max_move
    with pytest.raises(GclError, match='max_distance is 0'):
        RegistrarConfig(max_distance=0)


def test_what_refinement_does_not_confirm_has_no_probability(drive):
    timid = Registrar(RegistrarConfig(headings=1, refine=RefineConfig(max_move=1e-6)))
    result = timid.register(source=drive.scan(98), target=drive.scan(90))
    assert (result.accepted, result.probability, result.covariance) == (False, 0.0, None)
    assert result.reason.startswith('refinement does not confirm')


def test_one_heading_is_that_of_the_other_scan_where_a_street_lies_across(same_heading, drive):
    """At 45 degrees one scan is turned to the street one way, the other the other way."""
    clouds = [
        PointCloud(se3.transform(se3.from_xyz_rpy(yaw=np.deg2rad(off)), drive.scan(i).points))
        for i, off in ((98, 40.0), (90, 50.0))
    ]
    source, target = map(same_heading.view, clouds)
    assert abs(se3.yaw(source.T_view_lidar @ se3.inverse(target.T_view_lidar))) > 1.0
    result = same_heading.register_views(source=source, target=target)
    assert result.accepted
    T = result.T_target_source
    assert len(agreeing(same_heading, T, source=source, target=target)) > 100


def test_same_scans_same_transform(same_heading, drive):
    first, second = (
        same_heading.register(source=drive.scan(98), target=drive.scan(90)).T_target_source
        for _ in range(2)
    )
    assert np.array_equal(first, second)


def test_a_hypothesis_out_of_the_race_is_examined_as_it_is(same_heading, drive):
    views = {
        'source': same_heading.view(drive.scan(98)),
        'target': same_heading.view(drive.scan(90)),
    }
    (look,) = same_heading.looks(**views)
    hypotheses, _ = same_heading.hypotheses(
        same_heading.search(views['target'], Stopwatch()), look
    )
    odds = torch.full((len(hypotheses),), -100.0)
    odds[0], odds[1] = 5.0, -50.0
    scene = same_heading.scene(**views)
    first, second = same_heading.finalists(hypotheses, odds, scene, **views)
    assert not first.refined.walked
    T = views['target'].T_view_lidar @ T_target_source(drive, source=98, target=90)
    T = T @ se3.inverse(views['source'].T_view_lidar)
    assert metrics.registered(first.refined.T_target_source, T, metrics.STRICT)
    assert second.refined.walked
    start = hypotheses[1].T_target_source.numpy()
    assert np.array_equal(second.refined.T_target_source, start)


@pytest.mark.parametrize('away', [20, 30])
def test_sixteen_beams_are_enough_to_be_accepted(same_heading, away):
    drive = SimulatedSequence(3, sensor='vlp16')
    result = same_heading.register(source=drive.scan(90 + away), target=drive.scan(90))
    T = T_target_source(drive, source=90 + away, target=90)
    assert metrics.registered(result.T_target_source, T, metrics.STRICT)
    assert result.accepted, result.reason


def test_noise_is_refused_with_a_reason(same_heading, drive):
    rng = np.random.default_rng(0)
    noise = rng.uniform([-40, -40, -2], [40, 40, 4], (20000, 3)).astype(np.float32)
    result = same_heading.register(source=PointCloud(noise), target=drive.scan(90))
    assert not result.accepted
    assert 'probability' in result.reason or 'refinement' in result.reason


def test_unrelated_streets_are_refused(registrar, drive):
    elsewhere = SimulatedSequence(8)
    result = registrar.register(source=elsewhere.scan(60), target=drive.scan(90))
    assert not result.accepted
    assert result.reason
    assert result.probability < 0.5


def test_what_is_refused_is_looked_at_again_at_more_headings(drive):
    """The street of one scan taken for one that lies 30 degrees off: a bend, or a wood."""
    registrar = Registrar()
    source, target = registrar.views(source=drive.scan(98), target=drive.scan(90))
    T = T_target_source(drive, source=98, target=90)
    plain = registrar.register_views(source=source, target=target)
    assert (plain.accepted, plain.headings) == (True, 1)
    bend = se3.from_xyz_rpy(yaw=np.pi / 6) @ source.T_view_lidar
    cloud = drive.scan(98).moved(bend)
    bent = View(
        bend,
        cloud,
        tuple(registrar.model.describe_headings(cloud)),
        surface(cloud),
        prepare(cloud, registrar.config.refine),
    )
    result = registrar.register_views(source=bent, target=target)
    assert (result.accepted, result.headings) == (True, 12)
    assert metrics.registered(result.T_target_source, T, metrics.STRICT)
    assert len(agreeing(registrar, result.T_target_source, source=bent, target=target)) > 100


def test_looks_go_from_one_heading_to_all_and_search_none_twice(registrar, drive):
    source, target = registrar.views(source=SimulatedSequence(8).scan(60), target=drive.scan(90))
    looks = list(registrar.looks(source=source, target=target))
    assert [len(look.headings) for look in looks] == [1, 4, 12]
    yaws = [h.yaw for h in looks[-1].headings]
    assert sorted(np.rad2deg(yaws).round().tolist()) == list(range(0, 360, 30))
    search = registrar.search(target, Stopwatch())
    found = [search.at(look.headings) for look in looks]
    assert [n for _, n in found] == sorted(n for _, n in found)
    assert all(a is b for a, b in zip(found[0][0], found[2][0]))


def test_scan_out_of_range_is_named(same_heading, drive):
    far = PointCloud(np.full((10, 3), 1000.0, np.float32))
    with pytest.raises(GclError, match='within 80 m'):
        same_heading.register(source=far, target=drive.scan(90))


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'headings': 3}, 'one of'),
        ({'device': 'tpu'}, 'choose auto, cpu'),
        ({'device': 'cuda'}, 'finds no GPU'),
    ],
)
def test_bad_settings_are_named(change, words):
    if change == {'device': 'cuda'} and torch.cuda.is_available():
        pytest.skip('torch finds a GPU')
    with pytest.raises(GclError, match=words):
        Registrar(RegistrarConfig(**change))


@pytest.mark.skipif(not torch.cuda.is_available(), reason='torch finds no GPU')
def test_a_gpu_describes_as_the_cpu_does(drive):
    cpu, cuda = (
        Registrar(RegistrarConfig(device=device, precision='float32')).view(drive.scan(90))
        for device in ('cpu', 'cuda')
    )
    torch.testing.assert_close(cpu.features.points, cuda.features.points)
    alike = (cpu.features.descriptors * cuda.features.descriptors).sum(1)
    assert float(alike.min()) > 0.999


def test_a_handful_of_points_is_no_scan(same_heading, drive):
    """Anything fits a handful of points: they are refused, however well they agree."""
    few = PointCloud(drive.scan(90).points[::4000])
    result = same_heading.register(source=few, target=few)
    assert not result.accepted
    assert 'key points' in result.reason
