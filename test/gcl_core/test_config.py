from pathlib import Path

import pytest

from gcl_core.config import from_mapping, load_config
from gcl_core.errors import GclError
from gcl_core.models.kpconv_resunet import KPConvConfig
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.registrar import RegistrarConfig
from gcl_core.training.trainer import TrainConfig

CONFIG = Path(__file__).parents[2] / 'config'


def test_nested_values_and_defaults():
    values = {'headings': 4, 'estimator': {'ransac': {'threshold': 1}}}
    config = from_mapping(RegistrarConfig, values, 'x')
    assert (config.headings, config.estimator.ransac.threshold) == (4, 1.0)
    assert config.min_probability == RegistrarConfig().min_probability


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'turns': 12}, "unknown key 'turns'"),
        ({'headings': 'many'}, "headings: expected int, got 'many'"),
        ({'headings': True}, 'headings: expected int'),
        ({'headings': 0}, 'headings is 0'),
        ({'estimator': 3}, 'estimator: expected a mapping'),
        ({'estimator': {'name': 'best'}}, "'best' is none of ransac, spatial_consistency"),
        ({'estimator': {'ransac': {'model': 'best'}}}, "'best' is none of level, rigid"),
        ({'refine': {'reach': 2.0}}, 'reach: expected a list'),
        ({'refine': {'reach': [2.0]}}, 'refine.reach 1'),
        ({'min_probability': 2.0}, 'min_probability is 2'),
        ({'match': {'k': 0}}, 'match.k is 0'),
        ({'verify': {'finalists': 0}}, 'verify.finalists is 0'),
    ],
)
def test_bad_values_are_named(values, message):
    with pytest.raises(GclError, match=message):
        from_mapping(RegistrarConfig, values, 'here')


def test_broken_files_are_named(tmp_path):
    with pytest.raises(GclError, match='cannot read config'):
        load_config(RegistrarConfig, tmp_path / 'none.yaml')
    (tmp_path / 'bad.yaml').write_text('a: [1')
    with pytest.raises(GclError, match='not valid YAML'):
        load_config(RegistrarConfig, tmp_path / 'bad.yaml')


def test_the_backbone_chooses_the_config():
    conv, kpconv = ({'voxel_size': 0.2}, {'backbone': 'kpconv', 'width': 16})
    for values, kind in ((conv, ResUNetConfig), (kpconv, KPConvConfig)):
        assert isinstance(from_mapping(TrainConfig, {'network': values}, 'x').network, kind)
    with pytest.raises(GclError, match="network: backbone: 'best' is none of conv, kpconv"):
        from_mapping(TrainConfig, {'network': {'backbone': 'best'}}, 'x')
    with pytest.raises(GclError, match="unknown key 'encoder'"):
        from_mapping(TrainConfig, {'network': {'backbone': 'kpconv', 'encoder': [1]}}, 'x')


@pytest.mark.parametrize('path', sorted(CONFIG.glob('train_*.yaml')), ids=lambda p: p.name)
def test_training_configs_load(path):
    load_config(TrainConfig, path)


def test_settings_stand_above_the_file(tmp_path):
    (tmp_path / 'a.yaml').write_text('loss: {pair: 0.5}\n')
    settings = ['loss.finest=0', 'samples.pair_stages=[[5, 20]]', 'steps=7', 'loss.pair=2.0']
    config = load_config(TrainConfig, tmp_path / 'a.yaml', settings)
    assert (config.loss.pair, config.loss.finest, config.steps) == (2.0, 0.0, 7)
    assert config.samples.pair_stages == ((5.0, 20.0),)
    for setting, message in [
        ('steps', "'steps' sets nothing"),
        ('steps.a=1', "'steps.a=1' sets nothing|expected int"),
        ('step=1', "unknown key 'step'"),
        ('steps=[', 'not valid YAML'),
    ]:
        with pytest.raises(GclError, match=message):
            load_config(TrainConfig, tmp_path / 'a.yaml', [setting])
