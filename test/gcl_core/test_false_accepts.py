"""Pairs that must not be accepted: how they are made, run, resumed and counted."""

import argparse
import json

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError
from gcl_core.evaluation import adversaries, false_accepts
from gcl_core.evaluation.accept_tables import Row, by_distance, by_kind, markdown
from gcl_core.evaluation.barren import BarrenSequence
from gcl_core.evaluation.encounters import see
from gcl_core.registrar import Registrar, RegistrarConfig


@pytest.fixture(scope='module')
def registrar():
    return Registrar(RegistrarConfig(headings=1))


def row(kind='unrelated', accepted=False, right=False, near=False, distance=None):
    return Row(kind, 1, distance, accepted, 0.99 if accepted else 0.1, right, near, '')


def test_a_case_takes_the_whole_way(drive):
    registrar = Registrar()
    T_true = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    source, target = registrar.views(source=drive.scan(98), target=drive.scan(90))
    row = false_accepts.judge(registrar, adversaries.Case('true', source, target, T_true))
    assert (row.headings, row.accepted, row.right) == (1, True, True)
    other = registrar.view(SimulatedSequence(8).scan(60))
    row = false_accepts.judge(registrar, adversaries.Case('unrelated', other, target, None))
    assert (row.headings, row.accepted, row.right) == (12, False, False)


def test_tables_count_what_they_say():
    rows = [row()] * 8 + [row(accepted=True, near=True), row(accepted=True)]
    rows += [row('true', True, True, True, 12.0), row('true', False, True, True, 15.0)]
    table = {r['kind']: r for r in by_kind(rows)}
    assert table['unrelated']['pairs'] == 10
    assert (table['unrelated']['wrong'], table['unrelated']['beyond_2m_5deg']) == (2, 1)
    assert table['all']['accepted'] == 3
    assert table['all']['wrong'] == 2
    near = next(r for r in by_distance(rows) if r['metres'] == [10, 20])
    assert (near['pairs'], near['right'], near['refused']) == (2, 2, 1)
    assert '| unrelated | 10 | 2 | 2 | 1 |' in markdown(rows)


def test_a_run_goes_on_where_it_was_stopped(registrar, tmp_path, monkeypatch, capsys):
    made = []

    def few(registrar, number, sensor):
        made.append(number)
        drive = BarrenSequence(number, 'field', sensor=sensor)
        view = see(registrar, drive, 60, np.random.default_rng(0)).view
        yield adversaries.Case('field', view, view, None)

    monkeypatch.setattr(false_accepts, 'group', few)
    options = argparse.Namespace(
        weights=RegistrarConfig().weights,
        sensor='vlp16',
        chunks=tmp_path / 'chunks',
        pairs=2 * false_accepts.PAIRS,
        first=1,
        last=None,
        seconds=60.0,
        out=tmp_path / 'trust.json',
    )
    false_accepts.run(options)
    assert made == [1, 2]
    options.pairs += 1
    false_accepts.run(options)
    assert made == [1, 2, 3]
    content = json.loads(options.out.read_text())
    assert content['by_kind'][-1]['pairs'] == 3
    assert '| field | 3 |' in capsys.readouterr().out
    options.sensor = 'hdl64e'  # of which there is none among them
    options.last = 0
    with pytest.raises(GclError, match='no group of pairs'):
        false_accepts.run(options)


@pytest.mark.parametrize('kind', ['tunnel', 'field'])
def test_barren_places_look_the_same_everywhere(kind):
    place = BarrenSequence(5, kind)
    points = place.scan(60).points
    assert len(points) > 10_000
    assert np.array_equal(points, BarrenSequence(5, kind).scan(60).points)
    inside = np.abs(points[:, 0]) < 30
    height = np.percentile(points[inside, 2] + 1.8, [1, 99])
    assert (height[1] > 1.0) == (kind == 'tunnel')


def test_barren_and_mirrored_pairs_are_refused(registrar, drive):
    rng = np.random.default_rng(0)
    field = list(adversaries.barren(registrar, 1, 'field', 'hdl64e', rng))[:2]
    mirrored = see(registrar, drive, 90, rng, change=adversaries.MIRROR)
    target = see(registrar, drive, 92, rng)
    field.append(adversaries.Case('mirrored', mirrored.view, target.view, None))
    for case in field:
        assert not false_accepts.judge(registrar, case).accepted


def test_one_cloud_twice_is_the_identity(registrar, drive):
    judged = false_accepts.judge(registrar, adversaries.twice(registrar, drive, 90))
    assert judged.right
    assert judged.accepted
    assert judged.distance == 0.0


def test_a_sensor_that_has_not_moved_is_found_where_it_stands(registrar, drive):
    """Two looks from one place: other tilt, heading and noise."""
    looks = [see(registrar, drive, 90, np.random.default_rng(seed)) for seed in (0, 1)]
    judged = false_accepts.judge(registrar, adversaries.between('static sensor', *looks))
    assert judged.accepted
    assert judged.right
    assert judged.distance < 1e-6


def test_a_turned_cloud_keeps_its_place(registrar, drive):
    seen = see(registrar, drive, 90, np.random.default_rng(0), change=adversaries.UPSIDE_DOWN)
    up = seen.T_world_lidar[:3, :3] @ np.array([0.0, 0.0, 1.0])
    assert up[2] < -0.98
    away = seen.T_world_lidar[:3, 3] - drive.T_world_lidar(90)[:3, 3]
    assert np.abs(away).max() < 1e-6
    assert se3.rotation_angle(seen.T_world_lidar) > 0
