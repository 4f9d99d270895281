"""`gcl_core.register`: whatever is at hand goes in, one result comes out."""

import os
import subprocess
import sys

import numpy as np
import pytest

import gcl_core
from gcl_core.data.clouds import write_cloud
from gcl_core.data.simulator.sequence import SimulatedSequence


@pytest.fixture(scope='module')
def pair():
    street = SimulatedSequence(61)
    return street.scan(80), street.scan(92)


@pytest.fixture(scope='module')
def registrar():
    return gcl_core.Registrar()


def test_arrays_clouds_and_files_come_to_the_same(pair, registrar, tmp_path):
    source, target = pair
    result = gcl_core.register(source.points, target.points, registrar=registrar)
    assert result.accepted
    assert abs(np.linalg.norm(result.T_target_source[:3, 3]) - 12) < 0.6
    assert result.reason == ''
    assert result.covariance.shape == (6, 6)
    file = tmp_path / 'source.npy'
    write_cloud(file, source)
    extra_columns = np.column_stack([target.points, np.zeros(len(target))])
    for given in ((source, target), (str(file), target.points), (file, extra_columns)):
        again = gcl_core.register(*given, registrar=registrar)
        np.testing.assert_array_equal(again.T_target_source, result.T_target_source)


@pytest.mark.parametrize(
    ('source', 'words'),
    [
        (np.zeros((2, 5, 3)), r'source: expected an \(n, 3\) array'),
        (np.zeros((3, 100), np.float32), r'give array\.T'),
        (np.full((10, 3), np.nan), 'source: none of its 10 points is finite'),
        ([[1.0, 2.0, 3.0]], 'source: expected a PointCloud, got list'),
        (None, 'source: expected a PointCloud, got NoneType'),
        ('missing.bin', 'no file missing.bin'),
    ],
)
def test_bad_input_is_one_error(source, words, registrar):
    with pytest.raises(gcl_core.GclError, match=words):
        gcl_core.register(source, np.zeros((10, 3), np.float32), registrar=registrar)


def test_importing_the_package_loads_nothing_heavy():
    code = (
        'import sys, gcl_core\n'
        'assert not {"torch", "numpy", "scipy", "open3d"} & set(sys.modules)\n'
        'assert gcl_core.register and "torch" in sys.modules\n'
        'try: gcl_core.nothing\n'
        'except AttributeError as error: print(error)\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == "module 'gcl_core' has no attribute 'nothing'\n"


@pytest.mark.parametrize(('own', 'held'), [(None, 'PASSIVE'), ('ACTIVE', 'ACTIVE')])
def test_waiting_threads_sleep_unless_the_user_wants_them_to_spin(own, held):
    code = 'import gcl_core, os, sys; print(os.environ["OMP_WAIT_POLICY"], "torch" in sys.modules)'
    environment = {k: v for k, v in os.environ.items() if k != 'OMP_WAIT_POLICY'}
    if own:
        environment['OMP_WAIT_POLICY'] = own
    done = subprocess.run(
        [sys.executable, '-c', code], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [held, 'False']
