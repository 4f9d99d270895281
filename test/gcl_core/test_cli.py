"""Every subcommand on small data."""

import json

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.data.clouds import read_cloud, write_cloud
from gcl_core.evaluation import metrics


@pytest.fixture(scope='module')
def pair(tmp_path_factory, drive):
    folder = tmp_path_factory.mktemp('pair')
    write_cloud(folder / 'target.bin', drive.scan(90))
    write_cloud(folder / 'source.ply', drive.scan(98))
    (folder / 'fast.yaml').write_text('turns: 1\n')
    return folder


def test_register_prints_one_json_object_and_writes_files(pair, drive, capsys):
    code = main(
        ['register', str(pair / 'source.ply'), str(pair / 'target.bin'), '--json']
        + ['--config', str(pair / 'fast.yaml'), '--aligned', str(pair / 'aligned.pcd')]
        + ['--picture', str(pair / 'pair.png')]
    )
    assert code == 0
    out = json.loads(capsys.readouterr().out)
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    assert out['accepted'] is True
    assert 0.9 <= out['probability'] <= 1
    assert np.linalg.eigvalsh(np.array(out['covariance'])).min() > 0
    assert out['inliers'] > 10
    assert out['ms']['total'] > 0
    assert metrics.registered(np.array(out['T_target_source']), T, metrics.STRICT)
    assert len(read_cloud(pair / 'aligned.pcd')) == len(drive.scan(98))
    assert (pair / 'pair.png').stat().st_size > 10_000


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['register', 'no.bin', 'no.bin'], 'no file no.bin'),
        (['register', 'no.las', 'no.bin'], "unknown format '.las'"),
        (['train', '--config', 'no.yaml', '--out', 'x'], 'cannot read config no.yaml'),
        (['evaluate', '--kitti', 'nowhere', '--sequence', '08'], 'no folder nowhere'),
        (['bag', 'from-kitti', 'nowhere', '08', 'b', '--distance', '20'], 'no folder nowhere'),
    ],
)
def test_bad_input_exits_with_two_and_says_why(arguments, message, capsys):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def test_weights_that_do_not_exist_exit_with_two(pair, capsys):
    (pair / 'bad.yaml').write_text('weights: other\n')
    arguments = ['register', str(pair / 'source.ply'), str(pair / 'target.bin')]
    assert main([*arguments, '--config', str(pair / 'bad.yaml')]) == 2
    assert "no weights 'other'" in capsys.readouterr().err


def test_evaluate_prints_a_table(tmp_path, pair, capsys):
    code = main(
        ['evaluate', '--simulated', '3', '--per-bin', '1', '--config', str(pair / 'fast.yaml')]
        + ['--out', str(tmp_path / 'result.json')]
    )
    assert code == 0
    assert '| GCL-ROS | 5–10 | 1 |' in capsys.readouterr().out
    result = json.loads((tmp_path / 'result.json').read_text())
    assert len(result['predictions']) == 5
    assert result['config']['turns'] == 1


def test_evaluate_compares_estimators(pair, capsys):
    code = main(
        ['evaluate', '--simulated', '3', '--per-bin', '1', '--config', str(pair / 'fast.yaml')]
        + ['--estimators', 'ransac', 'spatial_consistency', '--features', 'ours']
    )
    assert code == 0
    out = capsys.readouterr().out
    assert '| ours + ransac | 5–10 | 1 | 100 (' in out
    assert '| ours + spatial_consistency | 5–10 | 1 | 100 (' in out


def test_train_writes_weights_that_register_reads(tmp_path, pair, capsys):
    (tmp_path / 'train.yaml').write_text(
        'steps: 2\nbf16: false\n'
        'network: {voxel_size: 0.6, max_range: 25.0, encoder: [4, 4, 4, 4], decoder: [4, 4]}\n'
        'samples: {phi: 1, sensor: hdl32e}\nloss: {groups: 64}\n'
    )
    arguments = ['--config', str(tmp_path / 'train.yaml'), '--out', str(tmp_path / 'run')]
    assert main(['train', *arguments]) == 0
    assert (tmp_path / 'run/curves.png').exists()
    weights = tmp_path / 'run/weights.safetensors'
    (tmp_path / 'own.yaml').write_text(f'weights: {weights}\nturns: 1\nmin_probability: 1.0\n')
    files = [str(pair / 'source.ply'), str(pair / 'target.bin')]
    assert main(['register', *files, '--config', str(tmp_path / 'own.yaml')]) == 1
    out = capsys.readouterr().out
    assert 'NOT ACCEPTED' in out or 'no transform found' in out
