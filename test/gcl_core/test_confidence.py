import json

import numpy as np
import pytest
import torch

from gcl_core.errors import GclError
from gcl_core.estimation.confidence import (
    Calibration,
    Judge,
    MadeWith,
    Spread,
    Stage,
    Trust,
    load_calibration,
    save_calibration,
)
from gcl_core.estimation.evidence import COLUMNS
from gcl_core.estimation.fit_judges import fit_choice, fit_judge, fit_trust
from gcl_core.models import zoo

SPREAD = Spread(factor=2.0, floor=0.01, floor_deg=0.02, upright=0.5, power=1.5)


def test_fit_recovers_probabilities():
    generator = torch.Generator().manual_seed(0)
    x = torch.randn(20_000, 2, generator=generator) * torch.tensor([1.0, 5.0]) + 3.0
    truth = Judge((1.5, -0.4), -0.7)
    p = truth.log_odds(x).sigmoid()
    right = torch.rand(20_000, generator=generator) < p
    fitted = fit_judge(x, right.float(), signs=(1, -1), ridge=0.0)
    assert fitted.weight == pytest.approx(truth.weight, abs=0.1)
    assert fitted.bias == pytest.approx(truth.bias, abs=0.3)


def test_weights_of_the_other_sign_are_left_out():
    x = torch.randn(500, 2, generator=torch.Generator().manual_seed(0))
    fitted = fit_judge(x, (x[:, 0] > 0.2).float(), signs=(-1, 1))
    assert fitted.weight[0] == 0.0
    assert np.isfinite(fitted.bias)


def test_separable_data_stay_finite():
    x = torch.tensor([[0.0], [1.0], [2.0], [3.0]])
    fitted = fit_judge(x, torch.tensor([0.0, 0.0, 1.0, 1.0]), signs=(1,))
    assert 0 < fitted.weight[0] < 1e3


@pytest.mark.parametrize('rank', [0, 3, 6])
def test_covariance_is_positive_definite(rank):
    rng = np.random.default_rng(rank)
    half = rng.normal(size=(6, rank)) * 1e4
    covariance = SPREAD.covariance(half @ half.T, 0.0)
    assert np.array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0
    np.linalg.cholesky(covariance)


def test_more_information_means_less_spread():
    little, much = (SPREAD.covariance(np.eye(6) * scale, 1.0) for scale in (10.0, 1000.0))
    assert (np.diag(much) < np.diag(little)).all()
    assert np.sqrt(much[0, 0]) >= 0.01


def test_surfaces_that_do_not_agree_mean_more_spread():
    well, badly = (SPREAD.covariance(np.eye(6) * 100.0, residual) for residual in (0.1, 1.0))
    np.testing.assert_allclose(badly, well * 10**SPREAD.power)
    assert well[2, 2] < well[0, 0]
    stacked = SPREAD.covariance(np.stack([np.eye(6) * 100.0] * 2), np.array([0.1, 1.0]))
    np.testing.assert_allclose(stacked, np.stack([well, badly]))


def test_a_good_fit_does_not_make_up_for_a_missing_lead():
    rng = np.random.default_rng(0)
    columns = torch.from_numpy(rng.uniform(-1, 1, (2000, 3)))
    right = (columns[:, 0] > 0) & (columns[:, 1] > 0)
    trust = fit_trust(columns, right)
    p = trust.probability(torch.tensor([[1.0, 1.0, 0.0], [1.0, -0.5, 0.0], [-0.5, 1.0, 0.0]]))
    assert p[0] > 0.95
    assert float(p[1:].max()) < 0.1
    assert torch.equal(trust.probability(columns), fit_trust(columns, right).probability(columns))


def test_choice_learns_what_differs_within_a_pair():
    # Column 0 varies from pair to pair and says nothing; column 1 is lower for the right one.
    rng = np.random.default_rng(0)
    pairs = []
    for _ in range(100):
        columns = rng.normal(size=(4, 2)) + [5 * rng.normal(), 0]
        right = torch.arange(4) == int(rng.integers(4))
        columns[right.numpy(), 1] -= 2.0
        pairs.append((torch.from_numpy(columns).float(), right))
    judge = fit_choice(pairs, signs=(1, -1), weight=[1.0] * 100)
    assert judge.bias == 0.0
    assert judge.weight[1] < -0.5
    found = sum(bool(right[int(judge.log_odds(c).argmax())]) for c, right in pairs)
    assert found > 60
    assert fit_choice(pairs[:0], signs=(1, -1), weight=[]).weight == (0.0, 0.0)


def test_calibration_survives_a_file(tmp_path):
    judge = Judge((0.5,) * len(COLUMNS), -1.0)
    stage = Stage(judge, judge)
    trust = Trust(Judge((1.0,), 0.0), Judge((2.0, 3.0), 0.0))
    calibration = Calibration(stage, stage, -4.0, trust, SPREAD, MadeWith('w', 's'))
    path = tmp_path / 'own.calibration.json'
    save_calibration(path, calibration, {'worlds': 3})
    assert load_calibration(path) == calibration
    assert json.loads(path.read_text())['record'] == {'worlds': 3}
    path.write_text(path.read_text().replace('floor_deg', 'florr'))
    with pytest.raises(GclError, match="unknown key 'florr'"):
        load_calibration(path)
    with pytest.raises(GclError, match=r'evaluation\.calibrate'):
        load_calibration(tmp_path / 'none.json')
    path.write_text(json.dumps({'estimated': {}}))
    with pytest.raises(GclError, match='is missing'):
        load_calibration(path)


def test_calibration_lies_beside_the_weights(tmp_path):
    shipped = zoo.calibration_file(zoo.DEFAULT)
    assert shipped.parent == zoo.FOLDER
    own = tmp_path / 'own.safetensors'
    assert zoo.calibration_file(str(own)) == shipped
    assert zoo.own_calibration(zoo.DEFAULT) == shipped
    beside = tmp_path / 'own.calibration.json'
    # Never the shipped one: it would be written over.
    assert zoo.own_calibration(str(own)) == beside
    beside.touch()
    assert zoo.calibration_file(str(own)) == beside
