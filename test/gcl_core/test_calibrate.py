"""Calibration on made-up trials, and one real trial of each kind."""

import argparse
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.confidence import Spread, load_calibration
from gcl_core.estimation.decision import Finalist, summary
from gcl_core.estimation.evidence import SIGNS
from gcl_core.estimation.refine import Refined
from gcl_core.evaluation import calibrate
from gcl_core.evaluation import encounters as encounters_module
from gcl_core.evaluation.encounters import (
    encounters,
    roughened,
    sources_of,
    targets_of,
    world,
)
from gcl_core.evaluation.reliability import fit_spread, joined, report, verdicts
from gcl_core.evaluation.repeated import RepeatedSequence
from gcl_core.evaluation.trials import (
    Trial,
    blurred,
    error,
    load_trials,
    run_trials,
    save_trials,
)
from gcl_core.files import sha256
from gcl_core.models import zoo
from gcl_core.registrar import Registrar, RegistrarConfig


@pytest.fixture(scope='module')
def registrar():
    return Registrar(RegistrarConfig(headings=1))


def finalist(rng, right, row, residual):
    speaks = np.array([-1, 1, 1, 1, 0, 1, 0, 1, -1, 0])
    columns = rng.normal(size=10) * 0.3 + speaks * (right - 0.5)
    information = np.diag(1.0 / np.array([0.02, 0.03, 0.02, 0.001, 0.001, 0.002]) ** 2)
    refined = Refined(np.eye(4), information, walked=False, residual=residual)
    rivals = torch.arange(2) != row
    return Finalist(refined, torch.from_numpy(columns).float(), 30, row, rivals)


def made_up(count, seed=0):
    """Trials whose errors grow with the residual, with a right one in every two."""
    rng = np.random.default_rng(seed)
    trials = []
    for i in range(count):
        right = i % 2 == 0
        residual = float(rng.uniform(0.1, 1.0))
        finalists = [finalist(rng, right, 0, residual), finalist(rng, False, 1, residual)]
        deviation = 3 * residual * np.array([0.02, 0.03, 0.02, 0.001, 0.001, 0.002])
        errors = np.stack([rng.normal(size=6) * deviation, np.full(6, 9.0)])
        if not right:
            errors[0] = 5.0
        trials.append(
            Trial(
                kind=('street', 'repeated', 'unrelated')[i % 3],
                distance=20.0,
                columns=torch.stack([f.columns for f in finalists]),
                right=torch.tensor([right, False]),
                finalists=finalists,
                errors=torch.from_numpy(errors),
            )
        )
    return trials


def test_fit_separates_right_from_wrong_and_covers_the_errors(registrar):
    calibration = calibrate.fit(made_up(400), registrar.calibration)
    held_out = made_up(400, seed=1)
    outcome = verdicts(held_out, calibration)
    p, right = outcome.probability, outcome.right
    assert float(p[right].median()) > 0.9 > 0.2 > float(p[~right].median())
    assert abs(float(p.mean()) - float(right.double().mean())) < 0.05
    square = outcome.square[~np.isnan(outcome.square)]
    assert np.mean(square <= 10.645) == pytest.approx(0.9, abs=0.06)
    assert np.mean(square <= 5.348) == pytest.approx(0.5, abs=0.12)
    assert 'wrong of 400 pairs accepted' in report(held_out, outcome)
    assert len(joined([outcome, outcome]).winners) == 800


def test_overconfident_information_is_widened(registrar):
    spread = fit_spread(made_up(300), calibrate.fit(made_up(300), registrar.calibration))
    assert isinstance(spread, Spread)
    assert spread.power == pytest.approx(2.0, abs=0.3)  # variance grows with the residual's square
    certain = spread.covariance(np.eye(6) * 1e12, 1.0)
    assert certain[0, 0] == pytest.approx(spread.floor**2, rel=1e-2)


def test_trials_survive_a_file(tmp_path):
    trials = made_up(5)
    save_trials(tmp_path / 't.safetensors', trials)
    again = load_trials(tmp_path / 't.safetensors')
    assert [t.kind for t in again] == [t.kind for t in trials]
    for a, b in zip(trials, again):
        assert torch.equal(a.columns, b.columns)
        assert torch.equal(a.errors, b.errors)
        assert torch.equal(a.strict, b.strict)
        assert a.distance == b.distance
        assert torch.equal(a.finalists[1].rivals, b.finalists[1].rivals)
        assert (a.finalists[1].row, b.finalists[1].row) == (1, 1)
        assert a.finalists[0].refined.residual == b.finalists[0].refined.residual
        assert np.array_equal(
            a.finalists[0].refined.information, b.finalists[0].refined.information
        )


@pytest.mark.parametrize('metadata', [{'kinds': '[["street", 20.0, true]]'}, None])
def test_trials_of_another_version_are_refused(metadata, tmp_path):
    path = tmp_path / 'world_00000.safetensors'
    save_file({'0/right': torch.ones(1)}, path, metadata=metadata)
    with pytest.raises(GclError, match='is of another version; remove it to collect it anew'):
        load_trials(path)


def test_command_writes_a_calibration_that_loads(tmp_path, capsys):
    folder = tmp_path / sha256(zoo.weights_file(RegistrarConfig().weights))[:12]
    folder.mkdir()
    for number in range(6):
        save_trials(folder / f'world_{number:05d}.safetensors', made_up(60, seed=number))
    options = argparse.Namespace(
        weights=RegistrarConfig().weights,
        trials=tmp_path,
        first=0,
        worlds=6,
        seconds=60.0,
        out=tmp_path / 'own.calibration.json',
        collect_only=False,
    )
    calibrate.run(options)
    said = capsys.readouterr().out
    assert 'wrote' in said
    assert said.startswith('360 pairs')
    written = load_calibration(tmp_path / 'own.calibration.json')
    assert written.spread.factor > 0
    assert written.estimated != Registrar().calibration.estimated
    assert written.made_with == Registrar().made_with
    options.trials, options.worlds = tmp_path / 'empty', 0
    with pytest.raises(GclError, match='0 worlds of trials'):
        calibrate.run(options)


def test_trial_of_a_pair_knows_which_finalist_is_right(registrar, drive):
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    source = blurred(registrar.view(drive.scan(98)), 0.02, torch.Generator().manual_seed(0))
    views = {'source': source, 'target': registrar.view(drive.scan(90))}
    (trial,) = run_trials(registrar, **views, T_true=T, kind='street')
    assert bool(trial.right.any())
    assert bool(trial.strict.any())
    assert trial.distance == pytest.approx(8.0, abs=0.5)
    (stranger,) = run_trials(registrar, **views, T_true=None, kind='unrelated')
    assert not bool(stranger.right.any() or stranger.strict.any())


def test_error_is_about_the_targets_axes():
    T = se3.from_xyz_rpy(x=10.0, yaw=1.0)
    moved = T.copy()
    moved[:3, 3] += [0.1, 0.2, 0.3]
    np.testing.assert_allclose(error(moved, T), [0.1, 0.2, 0.3, 0, 0, 0], atol=1e-9)
    turned = T.copy()
    turned[:3, :3] = se3.from_xyz_rpy(roll=0.01)[:3, :3] @ T[:3, :3]
    np.testing.assert_allclose(error(turned, T), [0, 0, 0, 0.01, 0, 0], atol=1e-9)


def test_repeated_streets_repeat(drive):
    world = RepeatedSequence(4)
    assert len(world) == 2 * (len(world) // 2)
    assert len(world.scan(60)) > 20_000
    assert np.array_equal(world.scan(60).points, RepeatedSequence(4).scan(60).points)
    far = world.T_world_lidar(60)[:3, 3] - world.T_world_lidar(60 + len(world) // 2)[:3, 3]
    assert np.linalg.norm(far) == pytest.approx(60.0, abs=2.0)


@pytest.mark.parametrize('seed', [12, 16])
def test_places_that_look_alike_are_tried_within_sight_and_out_of_it(registrar, seed):
    targets, sources = targets_of(registrar, seed), sources_of(registrar, seed)
    assert world(seed).kind == 'repeated'
    away = [np.linalg.norm((s.T_world_lidar - targets[0].T_world_lidar)[:3, 3]) for s in sources]
    assert max(away[:3]) < 75.0
    assert away[3] > 45.0


def test_trials_of_a_world_do_not_depend_on_what_ran_before(registrar, monkeypatch):
    monkeypatch.setattr(encounters_module, 'run_trials', lambda _, **pair: [pair])
    after_another = [list(encounters(registrar, seed)) for seed in (21, 22)][1]
    for cached in (targets_of, world):
        cached.cache_clear()
    alone = list(encounters(registrar, 22))
    assert [t['kind'] for t in alone] == [t['kind'] for t in after_another]
    assert {t['kind'] for t in alone} == {'street', 'unrelated'}
    for a, b in zip(alone, after_another):
        for side in ('source', 'target'):
            features = a[side].features, b[side].features
            assert torch.equal(features[0].descriptors, features[1].descriptors)


def test_roughening_keeps_the_scan(drive):
    scan = drive.scan(90)
    for seed in range(4):
        rough = roughened(scan, np.random.default_rng(seed))
        assert 0.4 * len(scan) < len(rough) <= len(scan)
        assert np.isfinite(rough.points).all()
        if len(rough) == len(scan):
            assert np.abs(rough.points - scan.points).max() < 1.0


def test_shipped_calibration_is_sane():
    calibration = load_calibration(zoo.calibration_file(RegistrarConfig().weights))
    for stage in (calibration.estimated, calibration.refined):
        for judge in (stage.fit, stage.choice):
            for weight, sign in zip(judge.weight, SIGNS.values(), strict=True):
                assert weight * sign >= 0
    assert all(w > 0 for w in (*calibration.trust.fits.weight, *calibration.trust.only.weight))
    assert 0 < calibration.spread.floor < 0.5


def test_hopeless_pairs_are_not_refined(registrar):
    trials = made_up(200)
    calibration = calibrate.fit(trials, registrar.calibration)
    gated = replace(calibration, gate=1e3)
    assert all(winner is None for winner in verdicts(trials, gated).winners)
    assert float(verdicts(trials, gated).probability.max()) == 0.0
    # The gate that was fitted costs no likely one.
    ungated = verdicts(trials, replace(calibration, gate=calibrate.NO_GATE))
    lost = (verdicts(trials, calibration).probability == 0) & (ungated.probability > 0.5)
    assert not bool((lost & ungated.right).any())


def test_a_lead_counts_other_places_only():
    rng = np.random.default_rng(0)
    calibration = load_calibration(zoo.calibration_file(RegistrarConfig().weights))
    first = replace(finalist(rng, True, 0, 0.2), rivals=torch.tensor([False, False, True]))
    examined = torch.stack([first.columns, first.columns + 1.0, first.columns])
    alone = replace(first, rivals=torch.zeros(3, dtype=torch.bool))
    judged = [summary([f], examined, calibration)[1][0] for f in (first, alone)]
    assert float(judged[0][2]) == 0.0  # as good as its only rival
    assert float(judged[1][2]) > 0.99  # no rival
