"""Benchmarks end to end on three pairs: once in one process, once in two, cut off and resumed."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.bench import results as bench
from gcl_core.cli.main import main
from gcl_core.config import load_config
from gcl_core.errors import GclError
from gcl_core.evaluation import metrics
from gcl_core.evaluation.benchmark import BenchmarkConfig, Ours, PairsConfig, SourceConfig
from gcl_core.evaluation.contestants import ready, registrar
from gcl_core.evaluation.plan import digest, draw, tasks
from gcl_core.evaluation.records import read_lines
from gcl_core.evaluation.runner import Run
from gcl_core.models import zoo
from gcl_core.registrar import RegistrarConfig
from gcl_core.types import PointCloud

PAIRS = ((1, 0), (2, 0), (3, 0))  # 1, 2 and 22 m apart: GICP finds the first two
TIMES = ('seconds', 'peak_mb')
GIVE = ('accepted', 'best')


@pytest.fixture(scope='module')
def data(tmp_path_factory, drive, write_folder):
    """A folder of four scans with poses, a list of three pairs, and a benchmark of them."""
    path = tmp_path_factory.mktemp('benchmark') / 'drive'
    write_folder(path, drive, (90, 91, 92, 112))
    lines = [f'drive {source} {target}' for source, target in PAIRS]
    (path.parent / 'list.txt').write_text('\n'.join(lines))
    (path.parent / 'bench.yaml').write_text(
        f'title: Three pairs\nsource: {{data: {path}}}\n'
        f'pairs: [{{kind: list, file: {path.parent}/list.txt, name: three}}]\n'
        'methods: [{kind: peer, name: gicp}]\npublished: [comparison_kitti, inference]\n'
        'criteria: [{rte: 0.1, rre_deg: 0.5}]\nworst: 2\n'
    )
    return path.parent


def evaluate(data, out, *more):
    return main(['evaluate', '--config', str(data / 'bench.yaml'), '--out', str(out), *more])


@pytest.fixture(scope='module')
def done(data, tmp_path_factory):
    out = tmp_path_factory.mktemp('done')
    assert evaluate(data, out) == 0
    return out


def timeless(rows):
    return [{k: v for k, v in row.items() if k not in TIMES} for row in rows]


def results(out):
    return json.loads((out / 'results.json').read_text())


def test_all_outputs_are_there(done):
    found = results(done)
    assert sum(row['strict'] for row in found['rows']) == 2
    assert [row['dataset'] for row in found['rows']] == ['three'] * len(found['rows'])
    assert sum(row['more'][0] for row in found['rows']) <= 2
    assert found['breakdowns']['overlap, %']
    assert found['commit']
    text = (done / 'results.md').read_text()
    assert '| gicp | 20–30 | 1 |' in text
    assert 'Published (Liu et al., ICCV 2023, table comparison_kitti)' in text
    page = (done / 'report.html').read_text()
    assert page.count('class="case"') == 2
    assert 'src=' not in page
    assert 'GCL+Conv, published' in page


def test_a_run_that_was_cut_off_goes_on(data, done, tmp_path):
    shutil.copytree(done, tmp_path / 'cut')
    path = tmp_path / 'cut/predictions-0.jsonl'
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(lines[0] + lines[1][:50])
    assert evaluate(data, tmp_path / 'cut') == 0
    assert timeless(results(tmp_path / 'cut')['rows']) == timeless(results(done)['rows'])
    assert path.read_text().startswith(lines[0])
    assert len(read_lines(tmp_path / 'cut')) == 3
    whole = path.read_text()
    assert evaluate(data, tmp_path / 'cut') == 0  # scores what is there
    assert path.read_text() == whole


def test_two_processes_come_to_the_same(data, done, tmp_path):
    torchrun = [sys.executable, '-m', 'torch.distributed.run', '--standalone']
    command = ['-m', 'gcl_core.cli.main', 'evaluate', '--config', str(data / 'bench.yaml')]
    ran = subprocess.run(
        [*torchrun, '--nproc_per_node', '2', *command, '--out', str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert ran.returncode == 0, ran.stderr
    assert timeless(results(tmp_path)['rows']) == timeless(results(done)['rows'])
    counts = [len((tmp_path / f'predictions-{i}.jsonl').read_text().splitlines()) for i in (0, 1)]
    assert counts == [2, 1]


def test_a_folder_of_another_run_is_refused(data, done, tmp_path, capsys):
    assert evaluate(data, done, '--random-yaw') == 2
    assert 'another config (random_yaw differs); take another --out' in capsys.readouterr().err
    run = json.loads((done / 'run.json').read_text())
    (tmp_path / 'run.json').write_text(json.dumps({**run, 'pairs_sha256': 'a' * 64}))
    assert evaluate(data, tmp_path) == 2
    assert 'the data or the list was changed' in capsys.readouterr().err
    (tmp_path / 'file').write_text('')
    assert evaluate(data, tmp_path / 'file') == 2
    assert 'must be a folder' in capsys.readouterr().err
    assert evaluate(data, tmp_path / 'x', '--peers', 'gicp') == 2
    assert 'methods stand in --config' in capsys.readouterr().err


def test_a_broken_record_is_named(data, done, tmp_path, capsys):
    shutil.copytree(done, tmp_path / 'broken')
    with (tmp_path / 'broken/predictions-0.jsonl').open('a') as file:
        file.write('{"method": 1}\n')
    assert evaluate(data, tmp_path / 'broken') == 2
    assert 'predictions-0.jsonl, line 4 is no prediction' in capsys.readouterr().err


def test_missing_weights_come_with_the_command_that_makes_them(data, tmp_path, capsys):
    (tmp_path / 'bench.yaml').write_text(
        'methods: [{registrar: {weights: runs/x/weights.safetensors}, '
        'trained_by: config/train_conv.yaml}]\n'
    )
    arguments = ['--config', str(tmp_path / 'bench.yaml'), '--simulated', '3']
    assert main(['evaluate', *arguments, '--out', str(tmp_path / 'out')]) == 2
    expected = '`gcl train --config config/train_conv.yaml --out runs/x`'
    assert expected in capsys.readouterr().err


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('methods: [{kind: peer, name: gicp}, {kind: peer, name: gicp}]', 'gicp come twice'),
        ('methods: [{kind: other}]', "'other' is none of ours, peer, estimators"),
        ('methods: []', 'methods is empty'),
        ('pairs: [{kind: list, per_bin: 0}]', 'per_bin is 0'),
        ('source: {sensors: [vlp16, hdl64e]}', '2 sensors given .vlp16, hdl64e. for 1'),
        ('source: {meet: dancing}', "'dancing' is none of"),
        ('figure: []', "unknown key 'figure'"),
        ('figures: [drifts]', "'drifts' is none of"),
        ('{methods: [{kind: peer, name: gicp}], figures: [drift]}', 'drift need a method of kind'),
        ('published: [x]', "no published table 'x'"),
    ],
)
def test_bad_benchmarks_are_named(tmp_path, text, message):
    (tmp_path / 'b.yaml').write_text(text)
    with pytest.raises(GclError, match=message):
        load_config(BenchmarkConfig, tmp_path / 'b.yaml')


class Straight:
    """Implements `Sequence`: a metre a scan, which sees one point a metre ahead."""

    def __init__(self, name):
        self.name = name

    def __len__(self):
        return 200

    def scan(self, index):
        return PointCloud(np.array([[1.0, 0.0, 0.0]], np.float32))

    def T_world_lidar(self, index):
        return se3.from_xyz_rpy(x=1.0 * index)


def test_sets_are_named_limited_and_turned_alike_however_they_are_run():
    source = SourceConfig(each=True)
    sets = (PairsConfig(per_bin=4), PairsConfig(kind='distance', ranges=((20, 30),), limit=1))
    config = BenchmarkConfig(source=source, pairs=sets, random_yaw=True, seed=3)
    sequences = {name: Straight(f'fake/{name}') for name in 'ab'}
    drawn = draw(config, sequences)
    assert [d.dataset for d in drawn] == ['fake/a', 'fake/a', 'fake/b', 'fake/b']
    assert [len(d.pairs.pairs) for d in drawn] == [20, 1, 20, 1]
    assert drawn[1].pairs.name.startswith('fake [20,30], 1 of ')
    found = tasks(config, drawn, sequences)
    assert [t.number for t in found] == list(range(42))
    assert sum(t.weighed for t in found) == 10
    # As a generator gives them one after the other: the README's figures were drawn so.
    rng = np.random.default_rng(3)
    assert [t.turned for t in found[:3]] == [rng.uniform(-np.pi, np.pi) for _ in range(3)]
    headings = [t.turned for t in found]
    assert len(set(headings)) == len(headings)  # no two sets or drives are turned alike
    assert digest(drawn) != digest(drawn[:1])
    together = draw(replace(config, source=SourceConfig(), pairs=sets[:1]), sequences)
    assert [d.dataset for d in together] == ['fake']
    low = draw(replace(config, pairs=(PairsConfig(kind='low_overlap', name='low'),)), sequences)
    assert [d.dataset for d in low] == ['low/a', 'low/b']
    far = replace(config, pairs=(PairsConfig(kind='distance', ranges=((90, 95),)),))
    with pytest.raises(GclError, match=r'no two scans as far apart as wanted \(fake \[90,95\]'):
        draw(far, sequences)


def test_ours_gives_both_answers_of_one_registration(drive):
    config = Ours(registrar=RegistrarConfig(headings=1, min_probability=1.0), give=GIVE)
    accepted, best = ready(config)(drive.scan(98), drive.scan(90))
    assert [accepted.method, best.method] == list(config.estimators)
    assert accepted.T_target_source is None
    T = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    assert metrics.registered(best.T_target_source, T, metrics.LOOSE)
    assert 0 < best.ms['features'] < best.ms['total']
    assert best.ms['data'] > 0
    fine = registrar(replace(config, voxel_size=0.25)).model
    assert fine.config.voxel_size == 0.25
    few, many = (len(m.describe([drive.scan(90)])[0]) for m in (zoo.load_weights(), fine))
    assert many > 1.1 * few


def test_vehicles_that_meet_make_pairs_of_both_sensors(tmp_path):
    (tmp_path / 'b.yaml').write_text(
        'source: {simulated: [3], meet: oncoming, sensors: [hdl64e, hdl32e]}\n'
        'pairs: [{per_bin: 1}]\nrandom_yaw: true\nmethods: [{kind: peer, name: gicp}]\n'
    )
    config = load_config(BenchmarkConfig, tmp_path / 'b.yaml')
    run = Run(config, tmp_path / 'out')
    assert len(run.tasks) == 5
    assert [task.weighed for task in run.tasks] == [True] * 5
    assert len({task.turned for task in run.tasks}) == 5
    predictions = run.predict()
    names = {'hdl64e', 'hdl32e'}
    assert all(set(p.sensors.split(' to ')) <= names for p in predictions)
    assert all(0 < p.overlap < 1 for p in predictions)
    assert np.ptp([p.pair.distance for p in predictions]) > 30


def test_pairs_between_vehicles_are_of_one_sensor_each(tmp_path):
    (tmp_path / 'b.yaml').write_text(
        'source: {simulated: [3], meet: oncoming}\npairs: [{per_bin: 2, between: true}]\n'
        'methods: [{kind: peer, name: gicp}]\n'
    )
    command = ['evaluate', '--config', str(tmp_path / 'b.yaml'), '--out', str(tmp_path / 'out')]
    assert main([*command, '--sensor', 'vlp16', 'hdl32e']) == 0
    rows = (tmp_path / 'out' / 'predictions-0.jsonl').read_text().splitlines()
    assert len(rows) == 10
    assert {json.loads(row)['sensors'] for row in rows} == {'hdl32e to vlp16'}


def test_pairs_between_vehicles_need_two(tmp_path, capsys):
    (tmp_path / 'b.yaml').write_text('pairs: [{between: true}]\nmethods: [{}]\n')
    assert main(['evaluate', '--config', str(tmp_path / 'b.yaml'), '--simulated', '3']) == 2
    assert 'sim/3 is one vehicle' in capsys.readouterr().err


def test_the_results_of_make_bench(data, tmp_path, monkeypatch, capsys):
    text = (data / 'bench.yaml').read_text()
    more = 'methods: [{kind: peer, name: gicp}, {kind: peer, name: fpfh}]'
    text = text.replace('methods: [{kind: peer, name: gicp}]', more)
    (tmp_path / 'bench_simulated.yaml').write_text(text)
    monkeypatch.setattr(bench, 'CONFIGS', tmp_path)
    monkeypatch.delenv('GCL_REAL_DATA', raising=False)
    arguments = ['--out', str(tmp_path / 'r.md'), '--json', str(tmp_path / 'r.json')]
    arguments += ['--folder', str(tmp_path / 'runs'), '--without', 'fpfh', 'kiss_matcher']
    bench.main(arguments)
    rows = json.loads((tmp_path / 'r.json').read_text())
    near, far = rows
    assert list(near) == [
        'dataset', 'method', 'estimator', 'lo_m', 'hi_m', 'yaw', 'pairs', 'rr_strict', 'rr_loose',
        'rte_median_m', 'rre_median_deg', 'ms', 'peak_mb',
    ]  # fmt: skip
    assert (near['method'], near['yaw'], near['rr_strict']) == ('gicp', 'driven', 1.0)
    assert (far['lo_m'], far['hi_m'], far['rte_median_m']) == (20, 30, None)
    written = (tmp_path / 'r.md').read_text()
    assert '## Three pairs' in written
    assert '### Strict recall by overlap, %\n\n| pairs of | method |' in written
    assert 'Published (Liu et al., ICCV 2023, table comparison_kitti); strict' in written
    assert 'commit' in written
    assert '| gicp | 20–30 | 1 | 0 (' in written
    with pytest.raises(SystemExit, match='2'):
        bench.main([*arguments, '--data', 'nowhere'])
    assert 'cannot read config' in capsys.readouterr().err
