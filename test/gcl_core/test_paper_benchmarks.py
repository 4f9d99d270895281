"""The benchmarks of the paper on small trees in the layouts of its data sets."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.config import load_config
from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_core.evaluation.benchmark import BenchmarkConfig, Estimators
from gcl_core.evaluation.compare import best_hypothesis, describe, settings
from gcl_core.evaluation.contestants import check_weights, ready
from gcl_core.evaluation.published import published
from gcl_core.registrar import RegistrarConfig
from gcl_core.training.recipe import TrainConfig
from gcl_core.types import PointCloud

CONFIG = Path(__file__).parents[2] / 'config'


@pytest.mark.parametrize(
    ('name', 'layout', 'sequences', 'listed'),
    [
        ('kitti', 'kitti', ['08-suma'], '08-suma'),
        ('lokitti', 'kitti', ['08-suma'], '8'),  # as the public list names it
        ('nuscenes', 'nuscenes', None, 'n015-2018'),
        ('lonuscenes', 'nuscenes', None, 'n015-2018'),
    ],
)
def test_benchmarks_run_on_their_layout(
    request, tmp_path_factory, name, layout, sequences, listed
):
    root, out = request.getfixturevalue(layout), tmp_path_factory.mktemp(name)
    (out / 'list.txt').write_text(f'{listed} 1 0\n')
    content = yaml.safe_load((CONFIG / f'bench_{name}.yaml').read_text())
    content['methods'] = [{'kind': 'peer', 'name': 'gicp'}]
    (out / 'bench.yaml').write_text(yaml.safe_dump(content))
    arguments = ['--config', str(out / 'bench.yaml'), '--data', str(root), '--out', str(out / 'o')]
    arguments += ['--pairs', str(out / 'list.txt')]
    arguments += ['--sequence', *sequences] if sequences else []
    assert main(['evaluate', *arguments]) == 0
    results = json.loads((out / 'o/results.json').read_text())
    assert [row['strict'] for row in results['rows']] == [1]
    assert results['sequences'] == [f'{layout}/{"08-suma" if sequences else listed}']
    assert [table['name'] for table in results['published']] == content.get('published', [])


def test_eth_is_scored_by_its_links(eth, tmp_path_factory):
    out = tmp_path_factory.mktemp('out')
    content = yaml.safe_load((CONFIG / 'bench_eth.yaml').read_text())
    content['methods'] = [{'voxel_size': 0.25}]  # the tiny tree is of street scans
    (out / 'bench.yaml').write_text(yaml.safe_dump(content))
    arguments = ['--config', str(out / 'bench.yaml'), '--data', str(eth.parent)]
    assert main(['evaluate', *arguments, '--out', str(out / 'o')]) == 0
    results = json.loads((out / 'o/results.json').read_text())
    scene, mean = results['figures'][0]['rows']
    assert (scene['scene'], scene['pairs']) == ('wood_autmn', 2)
    assert mean['fmr_percent'] == scene['fmr_percent']
    assert scene['mean_inlier_percent'] > 1  # 4 m apart
    assert 'voxels of 0.25 m' in results['figures'][0]['caption']


def test_the_papers_row_is_the_papers_protocol(drive):
    """One heading, one-way matches, no refinement; also where the axis of a street is unsure."""
    methods = load_config(BenchmarkConfig, CONFIG / 'bench_kitti.yaml').methods
    (paper,) = (method for method in methods if isinstance(method, Estimators))
    assert paper.registrar.estimator.open3d_ransac.samples == 4_000_000
    quick = replace(paper.registrar.estimator.open3d_ransac, samples=50_000)
    estimator = replace(paper.registrar.estimator, open3d_ransac=quick)
    contestant = ready(replace(paper, registrar=replace(paper.registrar, estimator=estimator)))
    turns = [se3.from_xyz_rpy(yaw=np.deg2rad(45 + way)) for way in (3, -3)]
    source, target = (
        PointCloud(se3.transform(T, drive.scan(i).points)) for T, i in zip(turns, (96, 90))
    )
    views = [contestant.registrar.model.facing(cloud) for cloud in (source, target)]
    assert abs(se3.yaw(views[0] @ se3.inverse(views[1]))) > 1  # a quarter turn apart
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(96)
    (outcome,) = contestant(source, target)
    T = turns[1] @ T @ se3.inverse(turns[0])
    assert metrics.registered(outcome.T_target_source, T, metrics.LOOSE)
    described = describe(contestant.registrar, 'ours', source, target)
    assert len(described.headings) == 1
    found = best_hypothesis(described, settings(contestant.registrar.config, 'paper'))
    np.testing.assert_array_equal(outcome.T_target_source, found)  # not refined


@pytest.mark.parametrize('path', sorted(CONFIG.glob('bench_*.yaml')), ids=lambda p: p.stem)
def test_benchmarks_name_recipes_that_exist(path):
    config = load_config(BenchmarkConfig, path)
    assert [published(name).name for name in config.published] == list(config.published)
    for method in config.methods:
        if recipe := getattr(method, 'trained_by', ''):
            file, *settings = recipe.split()
            load_config(TrainConfig, CONFIG.parent / file, settings[1:])
            assert settings[:1] in ([], ['--set'])
            with pytest.raises(GclError, match=f'gcl train --config {file}'):
                check_weights(replace(method, registrar=RegistrarConfig(weights='no.safetensors')))
