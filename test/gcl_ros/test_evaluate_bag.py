"""Evaluation on a bag: offline through the same registrar, its files, and evo's format."""

import csv
import json
import sys

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.types import PointCloud
from gcl_ros import evaluate_bag
from gcl_ros.bag import Encounter, write_bag
from gcl_ros.report import write_tum


@pytest.fixture(scope='module')
def bag(meeting, tmp_path_factory):
    """One pair that is found, and one of noise that is not."""
    source, target, T = meeting
    noise = np.random.default_rng(0).normal(size=(3000, 3)).astype(np.float32) * [20, 20, 2]
    pairs = [
        Encounter(1.0, PointCloud(source), PointCloud(target), T),
        Encounter(2.0, PointCloud(noise.astype(np.float32)), PointCloud(target), T),
    ]
    path = tmp_path_factory.mktemp('bags') / 'bag'
    write_bag(path, pairs, pair_list='two pairs')
    return path


def test_offline_writes_tables_pairs_and_trajectories(bag, tmp_path, monkeypatch, capsys, meeting):
    (tmp_path / 'fast.yaml').write_text('headings: 1\n')
    arguments = [str(bag), '--out', str(tmp_path / 'o'), '--offline']
    fast = ['--config', str(tmp_path / 'fast.yaml'), '--compact', '0.25']
    monkeypatch.setattr(sys, 'argv', ['evaluate_bag', *arguments, *fast])
    evaluate_bag.main()
    table = capsys.readouterr().out
    assert table.startswith('two pairs')
    assert '| GCL-ROS | 5–10 | 2 | 50 (' in table
    assert '| GCL-ROS, compact 0.25 m | 5–10 | 2 | 50 (' in table
    assert (tmp_path / 'o/table.md').read_text() == table
    result = json.loads((tmp_path / 'o/result.json').read_text())
    assert [row['wrong'] for row in result['rows']] == [0, 0]
    rows = list(csv.DictReader((tmp_path / 'o/pairs.csv').open()))
    assert [row['found'] for row in rows if row['method'] == 'GCL-ROS'] == ['1', '0']
    estimated = np.loadtxt(tmp_path / 'o/gcl_ros.tum', ndmin=2)
    truth = np.loadtxt(tmp_path / 'o/truth.tum', ndmin=2)
    assert estimated.shape == (1, 8)
    assert truth.shape == (2, 8)
    monkeypatch.setattr(sys, 'argv', ['evaluate_bag', *arguments, *fast[:2], '--json'])
    evaluate_bag.main()
    printed = json.loads(capsys.readouterr().out)
    assert printed['pairs'] == 'two pairs'
    assert [(row['method'], row['loose']) for row in printed['rows']] == [('GCL-ROS', 1)]
    T = se3.from_rotation_translation(se3.from_quaternion(*truth[0, 4:]), truth[0, 1:4])
    np.testing.assert_allclose(T, meeting[2], atol=1e-6)
    assert np.linalg.norm(estimated[0, 1:4] - truth[0, 1:4]) < metrics.STRICT.rte


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--config', 'x.yaml'], '--config x.yaml is for --offline'),
        (['--offline', '--set', 'headings:=1'], '--set headings:=1 is for the node'),
    ],
)
def test_options_that_would_be_ignored_are_refused(
    bag, tmp_path, monkeypatch, capsys, arguments, message
):
    out = tmp_path / 'o'
    monkeypatch.setattr(sys, 'argv', ['evaluate_bag', str(bag), '--out', str(out), *arguments])
    assert evaluate_bag.main() == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_a_trajectory_without_poses_is_an_empty_file(tmp_path):
    write_tum(tmp_path / 'none.tum', [(1.0, None)])
    assert (tmp_path / 'none.tum').read_text() == ''
