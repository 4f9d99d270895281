"""Fixtures shared by the tests: a small simulated drive, real scans where present."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch

from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.models.resunet import ResUNet, ResUNetConfig

REAL = Path(os.environ.get('GCL_REAL_DATA', Path(__file__).parents[2] / 'shared/data/real'))


@pytest.fixture(scope='session')
def drive() -> SimulatedSequence:
    """A street that training never sees."""
    return SimulatedSequence(3)


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


@pytest.fixture
def tiny_network() -> ResUNet:
    """Untrained network of a few thousand weights."""
    torch.manual_seed(0)
    config = ResUNetConfig(encoder=(4, 6, 8, 8), decoder=(8, 8, 8), head=8, descriptor=8)
    return ResUNet(config)
