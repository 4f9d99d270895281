"""Fixtures shared by the tests: a small simulated drive, real scans where present."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import emulation
import numpy as np
import pytest
import torch

from gcl_core.data.clouds import write_cloud
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.models import zoo
from gcl_core.models.backbone import Backbone
from gcl_core.models.kpconv_resunet import KPConvConfig
from gcl_core.models.resunet import ResUNetConfig

REAL = Path(os.environ.get('GCL_REAL_DATA', Path(__file__).parents[2] / 'shared/data/real'))


@pytest.fixture(scope='session')
def drive() -> SimulatedSequence:
    """A street that training never sees."""
    return SimulatedSequence(3)


@pytest.fixture(scope='session')
def write_folder() -> Callable[[Path, Sequence, Iterable[int]], None]:
    """Function that writes some scans of a drive into a folder, their poses beside them."""
    return _write_folder


def _write_folder(folder: Path, sequence: Sequence, indices: Iterable[int]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for i in indices:
        write_cloud(folder / f'{i}.npy', sequence.scan(i))
    poses = [sequence.T_world_lidar(i)[:3].ravel() for i in indices]
    np.savetxt(folder / 'poses.txt', poses)


@pytest.fixture(scope='session')
def real_root() -> Path:
    """KITTI-layout folder of real scans; skips where it is absent."""
    if not (REAL / 'sequences' / '80').is_dir():
        pytest.skip(f'no real scans at {REAL}; set GCL_REAL_DATA')
    return REAL


@pytest.fixture(scope='session')
def kitti_poses_root() -> Path:
    """KITTI odometry's poses without scans; skips where they are absent."""
    root = REAL.parent / 'kitti_odometry'
    if not (root / 'poses/08.txt').is_file():
        pytest.skip(f'no KITTI poses at {root}; they are looked for beside GCL_REAL_DATA')
    return root


@pytest.fixture(params=emulation.sets())
def compiled(request, monkeypatch) -> str:
    """The kernels held to each instruction set that can be run here; skips without a compiler."""
    emulation.hold(request.param, monkeypatch)
    return request.param


TINY = {
    'conv': ResUNetConfig(encoder=(4, 6, 8, 8), decoder=(8, 8, 8), head=8, descriptor=8),
    'kpconv': KPConvConfig(width=8, descriptor=8),
    'kpconv at 0.6 m': KPConvConfig(
        width=8, descriptor=8, output_level=1, decoder_blocks=False, height_input=True
    ),
}


@pytest.fixture(params=TINY)
def tiny_network(request) -> Backbone[Any, Any]:
    """Untrained network of a few thousand weights, of each backbone."""
    torch.manual_seed(0)
    return zoo.build(TINY[request.param])
