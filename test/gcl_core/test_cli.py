"""Every subcommand on small data."""

import json
from importlib.util import find_spec

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.data.clouds import read_cloud, write_cloud
from gcl_core.data.pair_list import read_pair_list
from gcl_core.evaluation import metrics


@pytest.fixture(scope='module')
def pair(tmp_path_factory, drive):
    folder = tmp_path_factory.mktemp('pair')
    write_cloud(folder / 'target.bin', drive.scan(90))
    write_cloud(folder / 'source.ply', drive.scan(98))
    (folder / 'fast.yaml').write_text('headings: 1\n')
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


def test_register_records_or_names_the_package(pair, tmp_path, capsys):
    files = [str(pair / 'source.ply'), str(pair / 'target.bin')]
    arguments = [*files, '--config', str(pair / 'fast.yaml'), '--rerun', str(tmp_path / 'a.rrd')]
    code = main(['register', *arguments])
    if find_spec('rerun') is None:
        assert code == 2
        assert 'pip install rerun-sdk' in capsys.readouterr().err
        return
    assert code == 0
    assert (tmp_path / 'a.rrd').stat().st_size > 1_000_000


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['register', 'no.bin', 'no.bin'], 'no file no.bin'),
        (['register', 'no.las', 'no.bin'], "unknown format '.las'"),
        (['train', '--config', 'no.yaml', '--out', 'x'], 'cannot read config no.yaml'),
        (['evaluate', '--data', 'nowhere'], 'no folder nowhere'),
        (['evaluate'], 'names no data; give --data DIR or --simulated SEED'),
        (['evaluate', '--simulated', '3', '--sequence', '08'], '--sequence 08 is of --data'),
        (['register', 'docs', 'no.bin'], 'docs is a folder; name one cloud'),
        (['bag', 'info', 'no_bag'], 'cannot read bag no_bag: it does not exist'),
        (['bag', 'info', 'docs'], 'no metadata.yaml in it'),
        (['evaluate', '--config', 'no.yaml'], 'cannot read config no.yaml'),
        (['train', '--config', 'config/train_conv.yaml', '--set', 'a', '--out', 'x'], "'a' sets"),
        (['pairs', 'p', '--data', 'nowhere', '--fcgf'], 'no folder nowhere'),
        (['bag', 'from-data', 'nowhere', 'b', '--pairs', '1'], 'no folder nowhere'),
        (['evaluate', '--data', 'nowhere', '--sequence', '08'], 'no folder nowhere'),
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
        ['evaluate', '--simulated', '3', '--per-bin', '1', '--registrar', str(pair / 'fast.yaml')]
        + ['--out', str(tmp_path)]
    )
    assert code == 0
    assert '| GCL-ROS | 5–10 | 1 |' in capsys.readouterr().out
    result = json.loads((tmp_path / 'results.json').read_text())
    assert [row['pairs'] for row in result['rows']] == [1] * 5
    assert result['config']['methods'][0]['registrar']['headings'] == 1


@pytest.fixture(scope='module')
def folder(tmp_path_factory, drive, write_folder):
    """A plain folder of scans 5 m apart, with poses."""
    path = tmp_path_factory.mktemp('drives') / 'a'
    write_folder(path, drive, range(20, 165, 5))
    return path


def test_evaluate_on_a_list_names_it_and_its_hash(tmp_path, pair, folder, capsys):
    assert main(['pairs', str(tmp_path / 'p.txt'), '--data', str(folder), '--random', '1']) == 0
    pairs = read_pair_list(tmp_path / 'p.txt')
    assert capsys.readouterr().out == f'wrote {pairs.label} to {tmp_path / "p.txt"}\n'
    assert len(pairs.pairs) == 5
    text = (tmp_path / 'p.txt').read_text().splitlines()
    (tmp_path / 'one.txt').write_text(text[-5])
    short = read_pair_list(tmp_path / 'one.txt')
    arguments = ['evaluate', '--data', str(folder), '--pairs', str(tmp_path / 'one.txt')]
    arguments += ['--registrar', str(pair / 'fast.yaml'), '--out', str(tmp_path / 'out')]
    assert main(arguments) == 0
    assert f'one, 1 pairs, sha256 {short.sha256[:12]}' in capsys.readouterr().out
    result = json.loads((tmp_path / 'out/results.json').read_text())
    listed = {'dataset': 'one', 'name': 'one', 'count': 1, 'sha256': short.sha256}
    assert result['pairs'] == [listed]
    assert result['sequences'] == ['folder/a']
    lines = (tmp_path / 'out/predictions-0.jsonl').read_text().splitlines()
    assert main([*arguments, '--json']) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {**printed, 'date': ''} == {**result, 'date': ''}
    predicted = [(p['pair']['source'], p['pair']['target']) for p in map(json.loads, lines)]
    assert predicted == [(p.source, p.target) for p in short.pairs]


@pytest.mark.parametrize(
    ('kind', 'size', 'name'),
    [(['--range', '5', '20'], 1, 'folder [5,20]'), (['--fcgf'], 5, 'folder [10,10]')],
)
def test_pairs_of_a_short_drive(tmp_path, folder, capsys, kind, size, name):
    arguments = ['pairs', str(tmp_path / 'p.txt'), '--data', str(folder), *kind, '--json']
    assert main(arguments) == 0
    pairs = read_pair_list(tmp_path / 'p.txt')
    assert pairs.name == name
    facts = json.loads(capsys.readouterr().out)
    assert (facts['name'], facts['pairs']) == (name, len(pairs.pairs))
    assert facts['sha256'] == pairs.sha256
    assert len(pairs.pairs) >= size


def test_low_overlap_pairs_of_a_short_drive_do_not_exist(tmp_path, folder, capsys):
    assert main(['pairs', str(tmp_path / 'p'), '--data', str(folder), '--low-overlap']) == 2
    assert 'has no such pair' in capsys.readouterr().err


def test_lists_of_other_drives_are_refused(tmp_path, folder, capsys):
    (tmp_path / 'p.txt').write_text('a 3 500\n')
    arguments = ['evaluate', '--data', str(folder), '--pairs', str(tmp_path / 'p.txt')]
    assert main(arguments) == 2
    assert 'lists scan 500 of a, but folder/a has 29 scans' in capsys.readouterr().err
    assert main([*arguments, '--sequence', 'b']) == 2
    assert 'lists no pair of b' in capsys.readouterr().err
    assert main(['evaluate', '--simulated', '3', *arguments[3:]]) == 2
    assert 'lists no pair of 3' in capsys.readouterr().err


def test_evaluate_compares_estimators(pair, capsys):
    code = main(
        ['evaluate', '--simulated', '3', '--per-bin', '1', '--registrar', str(pair / 'fast.yaml')]
        + ['--estimators', 'ransac', 'spatial_consistency', '--features', 'ours']
    )
    assert code == 0
    out = capsys.readouterr().out
    assert '| ours + ransac | 5–10 | 1 | 100 (' in out
    assert '| ours + spatial_consistency | 5–10 | 1 | 100 (' in out


@pytest.mark.parametrize(
    'shape',
    ['encoder: [4, 4, 4, 4], decoder: [4, 4]', 'backbone: kpconv, width: 8, output_level: 1'],
)
def test_train_writes_weights_that_register_reads(tmp_path, pair, capsys, shape):
    (tmp_path / 'train.yaml').write_text(
        'steps: 2\nbf16: false\n'
        f'network: {{voxel_size: 0.6, max_range: 25.0, {shape}}}\n'
        'samples: {phi: 1, simulation: {sensors: [hdl32e]}}\ngroups: {count: 64}\n'
    )
    arguments = ['--config', str(tmp_path / 'train.yaml'), '--out', str(tmp_path / 'run')]
    assert main(['train', *arguments]) == 0
    assert (tmp_path / 'run/curves.png').exists()
    weights = tmp_path / 'run/weights.safetensors'
    (tmp_path / 'own.yaml').write_text(f'weights: {weights}\nheadings: 1\nmin_probability: 1.0\n')
    files = [str(pair / 'source.ply'), str(pair / 'target.bin')]
    assert main(['register', *files, '--config', str(tmp_path / 'own.yaml')]) == 1
    out = capsys.readouterr().out
    assert 'NOT ACCEPTED' in out or 'no transform found' in out
