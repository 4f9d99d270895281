"""The same scans give the same bits at every stage, in any process, with any number of threads."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gcl_core import se3
from gcl_core.evaluation import metrics

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def pair(tmp_path_factory, drive) -> Path:
    folder = tmp_path_factory.mktemp('pair')
    np.save(folder / 'source.npy', drive.scan(98).points[::2])
    np.save(folder / 'target.npy', drive.scan(90).points[::2])
    return folder


def stages(folder: Path, *options: str, **environment: str) -> dict:
    done = subprocess.run(
        [sys.executable, str(ROOT / 'test/stages.py'), str(folder), *options],
        env={**os.environ, 'PYTHONPATH': str(ROOT), **environment},
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def same(runs: list[dict[str, str]]) -> None:
    for other in runs[1:]:
        assert [name for name in other if other[name] != runs[0][name]] == []


@pytest.mark.parametrize(
    ('weights', 'precision'), [('gcl_conv', 'auto'), ('gcl_kpconv', 'float32')]
)
def test_the_same_bits_in_every_process_and_with_every_number_of_threads(
    weights, precision, pair, drive
):
    T_true = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    # MKL's products, as COMPATIBLE has them, differ by the number of threads on any processor.
    first = stages(pair, weights, precision, '1', '2', '3', '5', MKL_CBWR='COMPATIBLE')
    again = stages(pair, weights, precision, '3', MKL_CBWR='COMPATIBLE', OPENBLAS_NUM_THREADS='1')
    assert metrics.registered(np.array(first['T']), T_true, metrics.STRICT)
    same([*first['runs'], *again['runs']])


def test_plain_torch_estimates_and_judges_the_same_with_every_number_of_threads(pair):
    same(stages(pair, 'gcl_conv', 'auto', '1', '2', '3', GCL_NATIVE='0')['runs'])
    same(stages(pair, 'gcl_conv', 'auto', '1', '3', GCL_NATIVE='0', MKL_CBWR='COMPATIBLE')['runs'])
