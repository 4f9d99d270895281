import json

import numpy as np
import pytest
import torch

from gcl_core.errors import GclError
from gcl_core.estimation.confidence import (
    Calibration,
    Judge,
    Spread,
    fit_judge,
    load_calibration,
    save_calibration,
)
from gcl_core.estimation.evidence import COLUMNS
from gcl_core.models import zoo
from gcl_core.registrar import calibration_file


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
    covariance = Spread(2.0, 0.01, 0.02).covariance(half @ half.T)
    assert np.array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0
    np.linalg.cholesky(covariance)


def test_more_information_means_less_spread():
    spread = Spread(2.0, 0.01, 0.02)
    little, much = (spread.covariance(np.eye(6) * scale) for scale in (10.0, 1000.0))
    assert (np.diag(much) < np.diag(little)).all()
    assert np.sqrt(much[0, 0]) >= 0.01


def test_calibration_survives_a_file(tmp_path):
    judge = Judge((0.5,) * len(COLUMNS), -1.0)
    calibration = Calibration(judge, judge, Judge((1.0, 2.0, 3.0), 0.0), Spread(1.0, 0.02, 0.05))
    path = tmp_path / 'own.calibration.json'
    save_calibration(path, calibration, {'worlds': 3})
    assert load_calibration(path) == calibration
    assert json.loads(path.read_text())['record'] == {'worlds': 3}
    path.write_text(path.read_text().replace('floor_deg', 'florr'))
    with pytest.raises(GclError, match="unknown key 'florr'"):
        load_calibration(path)
    with pytest.raises(GclError, match=r'evaluation\.calibrate'):
        load_calibration(tmp_path / 'none.json')


def test_calibration_lies_beside_the_weights(tmp_path):
    shipped = calibration_file(zoo.DEFAULT)
    assert shipped.parent == zoo.FOLDER
    own = tmp_path / 'own.safetensors'
    assert calibration_file(str(own)) == shipped
    beside = tmp_path / 'own.calibration.json'
    beside.touch()
    assert calibration_file(str(own)) == beside
