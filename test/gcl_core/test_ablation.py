import json
from dataclasses import asdict
from pathlib import Path

import pytest
import yaml

from gcl_core.config import load_config
from gcl_core.errors import GclError
from gcl_core.models.resunet import ResUNetConfig
from gcl_core.training import ablation
from gcl_core.training.ablation import AblationConfig, RunConfig, markdown, recipe, train
from gcl_core.training.recipe import GroupConfig, TrainConfig
from gcl_core.training.samples import SampleConfig
from gcl_core.training.simulated import SimulationConfig

RECIPE = TrainConfig(
    network=ResUNetConfig(
        voxel_size=0.6, max_range=25.0, encoder=(2, 2, 2, 2), decoder=(2, 2), head=2
    ),
    samples=SampleConfig(
        simulation=SimulationConfig(samples_per_world=100, sensors=('hdl32e',)), phi=2
    ),
    groups=GroupConfig(count=64),
    bf16=False,
)
SHIPPED = sorted((Path(__file__).parents[2] / 'config').glob('ablation*.yaml'))


def config_in(folder, *runs):
    plain = json.loads(json.dumps(asdict(RECIPE)))
    (folder / 'recipe.yaml').write_text(yaml.safe_dump(plain))
    return AblationConfig('recipe.yaml', 6, runs, ('save_every=1',))


@pytest.mark.parametrize('path', SHIPPED, ids=lambda path: path.stem)
def test_runs_describe_as_many_scans_whatever_is_sampled_together(path):
    config = load_config(AblationConfig, path)
    for run in config.runs:
        found = recipe(config, run, path.parent, 0)
        scans = 2 if found.samples.pair_stages else 1 + found.samples.phi
        assert found.steps * scans == pytest.approx(config.scans, abs=scans)


def test_a_run_after_another_goes_on_from_its_weights(tmp_path, monkeypatch):
    judged = []
    monkeypatch.setattr(ablation, 'validate', lambda model: judged.append(model) or FIGURES)
    first = RunConfig('first', ('Losses', 'Others'))
    second = RunConfig('second', ('Losses',), ('loss.contrast=0', 'loss.gcl_from=0'), 'first')
    config = config_in(tmp_path, first, second)
    results = [train(config, run, tmp_path, tmp_path / 'out') for run in config.runs]
    assert [found['step'] for found in results] == [2, 4]
    rows = [json.loads(r) for r in (tmp_path / 'out/second/log.jsonl').read_text().splitlines()]
    assert [row['step'] for row in rows] == [3, 4]
    assert all('contrast' not in row and row['negative'] >= 0 for row in rows)
    again = train(config, second, tmp_path, tmp_path / 'out')  # read, not trained
    assert (again['steps'], len(judged)) == (2, 2)
    table = markdown(results)
    assert table.count('| first | 2 | 50.0 |') == 2
    assert table.count('| second | 2 |') == 1
    assert '100 (89–100)' in table


FIGURES = {
    f'valid/{kind}_{low}_{high}': value
    for kind, value in (('inliers', 0.5), ('recall', 1.0))
    for low, high in ablation.BINS
}


@pytest.mark.parametrize(
    ('runs', 'message'),
    [
        ((RunConfig('a', ()), RunConfig('a', ())), 'two have the same name'),
        ((RunConfig('a', (), after='b'), RunConfig('b', ())), "after 'b', which is not above"),
    ],
)
def test_bad_lists_of_runs_are_named(runs, message):
    with pytest.raises(GclError, match=message):
        AblationConfig('recipe.yaml', 6, runs)
