"""The same scans give the same transform bit by bit, in any process, with one thread or two."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from gcl_core import se3
from gcl_core.evaluation import metrics

ROOT = Path(__file__).parents[2]
SCRIPT = """
import hashlib, json, sys
from pathlib import Path
import numpy as np
import torch
from gcl_core.data.clouds import read_cloud
from gcl_core.registrar import Registrar, RegistrarConfig
folder = Path(sys.argv[1])
source, target = (read_cloud(folder / f'{side}.npy') for side in ('source', 'target'))
result = Registrar(RegistrarConfig(turns=1)).register(source=source, target=target)
digest = hashlib.sha256(result.T_target_source.tobytes())
digest.update(result.covariance.tobytes())
digest.update(np.float64(result.probability).tobytes())
print(json.dumps([digest.hexdigest(), torch.get_num_threads(), result.T_target_source.tolist()]))
"""


def register(folder: Path, threads: int) -> list:
    done = subprocess.run(
        [sys.executable, '-c', SCRIPT, str(folder)],
        env=os.environ | {'OMP_NUM_THREADS': str(threads)},
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def test_the_same_bits_in_every_process_and_with_every_number_of_threads(tmp_path, drive):
    source, target = drive.scan(98), drive.scan(90)
    np.save(tmp_path / 'source.npy', source.points[::2])
    np.save(tmp_path / 'target.npy', target.points[::2])
    T_true = se3.inverse(drive.T_world_lidar(90)) @ drive.T_world_lidar(98)
    first, again, two = (register(tmp_path, threads) for threads in (1, 1, 2))
    assert (first[1], two[1]) == (1, 2)
    assert metrics.registered(np.array(first[2]), T_true, metrics.STRICT)
    assert first[0] == again[0], 'two processes differ'
    assert first[0] == two[0], 'one thread and two differ'
