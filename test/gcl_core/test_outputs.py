"""What commands write is checked before the work, and what they read is named."""

import json

import numpy as np
import pytest

from gcl_core.cli.main import main
from gcl_core.data.clouds import read_cloud, write_cloud
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud


@pytest.fixture(scope='module')
def pair(tmp_path_factory, drive):
    folder = tmp_path_factory.mktemp('pair')
    write_cloud(folder / 'source.pcd', drive.scan(98))
    points = drive.scan(90).points
    spare = np.full((len(points), 1), 3, np.float32)
    rows = np.hstack([points, spare, spare * 0, spare * 9])
    (folder / 'target.bin').write_bytes(rows.astype(np.float32).tobytes())
    write_cloud(folder / 'far.pcd', PointCloud(points + np.float32(1e5)))
    (folder / 'fast.yaml').write_text('headings: 1\n')
    (folder / 'text').write_text('')
    return folder


COMMANDS = [
    ('register', '{}/none.pcd {}/none.bin --picture {}/a.gif', "unknown format '.gif'; use .png"),
    ('register', '{}/none.pcd {}/none.bin --picture {}/text/a.png', 'cannot write'),
    ('register', '{}/none.pcd {}/none.bin --aligned {}/a.las', "a.las: unknown format '.las'"),
    ('register', '{}/none.pcd {}/none.bin --aligned {}/text/a.pcd', 'cannot write'),
    ('register', '{}/none.pcd {}/none.bin --aligned {}', 'unknown format'),
    ('register', '{}/source.pcd {}/far.pcd', '/far.pcd: none of its'),
    ('register', '{}/far.pcd {}/source.pcd', '/far.pcd: none of its'),
    ('register', '{}/source.pcd {}/source.pcd --columns 5', '--columns 5 is of a .bin'),
    ('register', '{}/source.pcd {}/target.bin --columns two', "columns 'two': give 3 or more"),
    ('register', '{}/source.pcd {}/target.bin --columns 7', 'not a multiple of 28'),
    ('pairs', '{}/text/list --data {}/none --fcgf', 'cannot write'),
    ('bag', 'from-data {}/none {}/text --pairs 1', 'text exists already; remove it'),
    ('bag', 'from-data {}/none {}/text/bag --pairs 1', 'cannot write'),
    ('inspect', '--data {}/none --scan 0 --picture {}/a.bmp', "unknown format '.bmp'; use .png"),
    ('inspect', '--data {}/none --scan 0 --picture {}/text/a.png', 'cannot write'),
]


@pytest.mark.parametrize(('command', 'arguments', 'words'), COMMANDS)
def test_a_command_refuses_before_the_work(command, arguments, words, pair, capsys):
    assert main([command, *arguments.replace('{}', str(pair)).split()]) == 2
    assert words in capsys.readouterr().err


def test_a_picture_shows_what_was_registered(pair, capsys, monkeypatch):
    """Each scan is described once; the JSON says how the .bin was read; folders are made."""
    described = []
    view = Registrar.view
    monkeypatch.setattr(
        Registrar, 'view', lambda self, *a, **k: described.append(1) or view(self, *a, **k)
    )
    files = [str(pair / name) for name in ('source.pcd', 'target.bin')]
    outputs = ['--picture', str(pair / 'new/a.PNG'), '--aligned', str(pair / 'new/a.Pcd')]
    assert main(['register', *files, '--config', str(pair / 'fast.yaml'), *outputs, '--json']) == 0
    assert json.loads(capsys.readouterr().out)['columns'] == {'target': '6 columns of float32'}
    assert len(described) == 2
    assert (pair / 'new/a.PNG').stat().st_size > 10_000
    assert len(read_cloud(pair / 'new/a.Pcd')) == len(read_cloud(pair / 'source.pcd'))
