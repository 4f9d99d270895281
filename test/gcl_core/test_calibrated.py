"""Probabilities say whether they were fitted for these weights, settings and kinds of scan."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from gcl_core.config import from_mapping
from gcl_core.errors import GclError
from gcl_core.estimation.decision import VerifyConfig
from gcl_core.estimation.estimators import EstimatorConfig
from gcl_core.estimation.evidence import COLUMNS, SPARSEST, SWEEP, evidence
from gcl_core.estimation.ransac import RansacConfig
from gcl_core.estimation.refine import RefineConfig
from gcl_core.estimation.spatial_consistency import SpatialConsistencyConfig
from gcl_core.matching import match
from gcl_core.matching.match import MatchConfig
from gcl_core.models import zoo
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import PointCloud

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def registrar():
    return Registrar(RegistrarConfig(headings=1))


@pytest.mark.parametrize('weights', sorted(p.stem for p in zoo.FOLDER.glob('*.safetensors')))
def test_shipped_weights_are_calibrated(weights):
    assert Registrar(RegistrarConfig(weights=weights)).uncalibrated == ''


INDIFFERENT = {
    'headings': 4,
    'device': 'cpu',
    'max_distance': 50.0,
    'min_probability': 0.5,
    'precision': 'float32',
    'refine': RefineConfig(threads=2),
    'estimator': EstimatorConfig(
        ransac=RansacConfig(seed=3), spatial_consistency=SpatialConsistencyConfig(seeds=9)
    ),
}
DIFFERENT = {
    'match': MatchConfig(keypoints=5000),
    'estimator': EstimatorConfig(name='spatial_consistency'),
    'verify': VerifyConfig(finalists=3),
    'refine': RefineConfig(max_move=1.0),
}


@pytest.mark.parametrize('name', INDIFFERENT)
def test_what_calibration_does_not_depend_on_may_change(name, registrar):
    other = replace(registrar.config, **{name: INDIFFERENT[name]})
    assert Registrar(other).uncalibrated == ''


@pytest.mark.parametrize('name', DIFFERENT)
def test_other_settings_are_uncalibrated(name, registrar):
    other = Registrar(replace(registrar.config, **{name: DIFFERENT[name]}))
    assert 'match, estimator, verify or refine' in other.uncalibrated
    assert 'gcl_core.evaluation.calibrate' in other.uncalibrated


def copied(folder: Path, *, calibration: bool) -> str:
    """The shipped weights in a file of one's own."""
    own = folder / 'own.safetensors'
    shutil.copy(zoo.weights_file(zoo.DEFAULT), own)
    if calibration:
        shutil.copy(zoo.own_calibration(zoo.DEFAULT), zoo.own_calibration(str(own)))
    return str(own)


def changed(path: str) -> None:
    """Another last bit of the last weight."""
    content = bytearray(Path(path).read_bytes())
    content[-4] ^= 1
    Path(path).write_bytes(content)


@pytest.mark.parametrize('beside', [False, True])
def test_the_calibration_of_other_weights_is_named_so(beside, tmp_path, drive):
    own = copied(tmp_path, calibration=beside)
    assert Registrar(RegistrarConfig(weights=own)).uncalibrated == ''  # the same file elsewhere
    changed(own)
    registrar = Registrar(RegistrarConfig(weights=own, headings=1))
    assert 'no calibration of their own' in registrar.uncalibrated
    result = registrar.register(source=drive.scan(98), target=drive.scan(90))
    assert (result.accepted, result.calibrated) == (True, False)


def test_a_calibration_that_names_nothing_holds_for_nothing(tmp_path):
    own = copied(tmp_path, calibration=True)
    path = zoo.own_calibration(own)
    content = json.loads(path.read_text())
    del content['made_with']
    path.write_text(json.dumps(content))
    assert 'uncalibrated' in Registrar(RegistrarConfig(weights=own)).uncalibrated


def test_results_without_a_transform_say_it_too(registrar, drive):
    view = registrar.view(drive.scan(90))
    few = registrar.view(PointCloud(drive.scan(90).points[::4000]))
    result = registrar.register_views(source=few, target=view)
    assert (result.T_target_source, result.calibrated) == (None, True)
    other = Registrar(replace(registrar.config, match=MatchConfig(keypoints=5000)))
    assert not other.register_views(source=few, target=view).calibrated


@pytest.mark.parametrize('count', [2000, 5999, 9000])
def test_the_sparser_scan_counts_as_no_sparser_than_any_that_judges_saw(count, registrar, drive):
    scan = drive.scan(90)
    rows = np.random.default_rng(0).choice(len(scan), count, replace=False)
    dense, sparse = registrar.view(scan), registrar.view(PointCloud(scan.points[rows]))
    for pair in ({'source': sparse, 'target': dense}, {'source': dense, 'target': sparse}):
        row = evidence(torch.eye(4)[None], torch.ones(1), registrar.scene(**pair), tolerance=0.3)
        expected = math.log(max(count, SPARSEST) / SWEEP)
        assert float(row[0, COLUMNS.index('log_points')]) == pytest.approx(expected)


NO_CLOUDS = {
    'an array': lambda points: points,
    'a list': lambda points: points.tolist(),
    'nothing': lambda _: None,
    'a transposed cloud': lambda points: _cloud(points.T),
    'a cloud of lists': lambda points: _cloud(points.tolist()),
}


def _cloud(points):
    cloud = object.__new__(PointCloud)
    object.__setattr__(cloud, 'points', points)
    return cloud


@pytest.mark.parametrize('kind', NO_CLOUDS)
@pytest.mark.parametrize('side', ['source', 'target'])
def test_what_is_no_cloud_is_named_with_the_remedy(kind, side, registrar, drive):
    given = {'source': drive.scan(98), 'target': drive.scan(90)}
    given[side] = NO_CLOUDS[kind](given[side].points[:100])
    with pytest.raises(GclError, match=rf'^{side}: expected a PointCloud.*from_array'):
        registrar.register(**given)
    with pytest.raises(GclError, match=r'expected a PointCloud.*from_array'):
        registrar.view(given[side])
    with pytest.raises(GclError, match=r'expected a PointCloud.*from_array'):
        registrar.views(**given)


@pytest.mark.parametrize('precision', ['float32', 'bfloat16'])
def test_precision_reaches_the_search_in_feature_space(precision, drive, monkeypatch):
    seen, search = [], match.mutual_nearest
    noted = lambda p, q: seen.append(p.dtype) or search(p, q)  # noqa: E731
    monkeypatch.setattr(match, 'mutual_nearest', noted)
    registrar = Registrar(RegistrarConfig(headings=1, precision=precision))
    registrar.register(source=drive.scan(98), target=drive.scan(90))
    assert {str(dtype) for dtype in seen} == {f'torch.{precision}'}


def test_the_shipped_settings_of_the_node_are_calibrated():
    path = ROOT / 'config/registrar.yaml'
    told = yaml.safe_load(path.read_text())['/**']['ros__parameters']['registrar']
    assert Registrar(from_mapping(RegistrarConfig, told, str(path))).uncalibrated == ''
