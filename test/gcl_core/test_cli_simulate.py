"""`gcl simulate` and `gcl inspect` on small data."""

import json
import sys

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.cli.main import main
from gcl_core.data.kitti import KittiSequence
from gcl_core.data.simulator.meeting import meet

FAST = ['--sensor', 'vlp16', '--scans', '3']


@pytest.fixture(scope='module')
def tree(tmp_path_factory):
    """Two vehicles that meet, in KITTI layout."""
    out = tmp_path_factory.mktemp('simulated') / 'out'
    arguments = ['simulate', '62', str(out), '--meet', 'oncoming', '--sensor', 'hdl32e', 'vlp16']
    assert main([*arguments, '--scans', '3']) == 0
    return out


def test_simulated_vehicles_are_read_back_with_their_poses(tree):
    first, second = meet(62, 'oncoming', sensors=('hdl32e', 'vlp16'))
    read = [KittiSequence(tree, name) for name in ('00', '01')]
    start = (len(first) - 3) // 2
    for name, written, drive in zip(('00', '01'), read, (first, second), strict=True):
        assert len(written) == 3
        np.testing.assert_array_equal(written.scan(2).points, drive.scan(start + 2).points)
        times = np.loadtxt(tree / f'sequences/{name}/times.txt')
        assert times[2] == pytest.approx(drive.stamp(2), abs=1e-4)
    T = se3.inverse(first.T_world_lidar(start + 1)) @ second.T_world_lidar(start + 1)
    between = se3.inverse(read[0].T_world_lidar(1)) @ read[1].T_world_lidar(1)
    np.testing.assert_allclose(between, T, atol=1e-6)


def test_one_vehicle_is_written(tmp_path, capsys):
    out = tmp_path / 'o'
    assert main(['simulate', '5', str(out), '--kind', 'rural', *FAST]) == 0
    assert 'wrote 3 scans of 1 vehicle(s), rural' in capsys.readouterr().out
    assert not (out / 'sequences' / '01').exists()
    assert main(['simulate', '5', str(out), *FAST]) == 2
    assert 'exists already' in capsys.readouterr().err


def test_a_bag_holds_both_vehicles(tmp_path):
    from gcl_ros.bag import read_encounters

    out = tmp_path / 'bag'
    assert main(['simulate', '62', str(out), '--meet', 'following', '--bag', *FAST]) == 0
    first, second = meet(62, 'following', sensors=('vlp16', 'vlp16'))
    encounters = list(read_encounters(out))
    start = (len(first) - 3) // 2
    assert len(encounters) == 3
    for i, encounter in enumerate(encounters, start):
        T = se3.inverse(first.T_world_lidar(i)) @ second.T_world_lidar(i)
        np.testing.assert_allclose(encounter.T_target_source, T, atol=1e-9)


def test_a_package_that_is_missing_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'gcl_ros.bag', None)
    out = str(tmp_path / 'bag')
    assert main(['simulate', '62', out, '--meet', 'oncoming', '--bag', *FAST]) == 2
    assert 'install what is missing' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['simulate', '5', 'x', '--bag'], 'say how they meet'),
        (['simulate', '5', 'x', '--sensor', 'vlp16', 'vlp16'], '2 sensors given'),
        (['simulate', '5', 'x', '--spacing', '1e-9'], 'spacing is 1e-09 m; it must be 0.001 to'),
        (['simulate', '5', 'x', '--spacing', '1e9'], 'spacing is 1e+09 m; it must be 0.001 to'),
        (['inspect', '--simulated', '5', '--sequence', '0'], '--sequence 0 is of --data'),
        (['inspect', '--simulated', '5', '--sensor', 'vlp16', '--scan', '900'], 'scans 0 to 180'),
        (['inspect', '--simulated', '5', '--pair', '0', '-1'], 'not -1'),
        (['inspect', '--data', 'nowhere'], 'no folder nowhere'),
    ],
)
def test_bad_input_exits_with_two(arguments, message, capsys):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ('what', 'expected', 'key'),
    [
        (['--scans', '2'], 'of 0.3 m a scan', 'points'),
        (['--scan', '1'], 'counted [1]', 'counted'),
        (['--pair', '2', '0'], 'overlap within 0.45 m', 'T_target_source'),
        (['--group', '1'], 'of its points form a group', 'share'),
    ],
)
def test_inspect_counts_and_draws(tree, tmp_path, what, expected, key, capsys):
    picture = tmp_path / 'p.png'
    arguments = ['inspect', '--data', str(tree), '--sequence', '00', *what]
    assert main([*arguments, '--picture', str(picture)]) == 0
    assert expected in capsys.readouterr().out
    assert picture.stat().st_size > 10_000
    assert main([*arguments, '--json']) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts['sequence'] == 'kitti/00'
    assert facts[key]


def test_inspect_compares_with_simulated_worlds(tree, tmp_path, capsys):
    picture = tmp_path / 'c.png'
    arguments = ['inspect', '--data', str(tree), '--sequence', '00', '--sensor', 'vlp16']
    arguments += ['--kind', 'park', '--compare', '1', '--hide-scan', '--picture', str(picture)]
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert 'kitti/00: ' in out
    assert 'simulated vlp16, park: ' in out
    assert picture.stat().st_size > 10_000
