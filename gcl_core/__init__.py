"""Distant registration of LiDAR scans with density-invariant features (GCL, ICCV 2023).

    result = gcl_core.register(source, target)    # arrays, PointCloud or files
    result.accepted, result.T_target_source, result.probability, result.covariance, result.reason

The way of the data, each arrow a type of `gcl_core.types`, each verb a folder:

    PointCloud2, raw or compact ─ gcl_ros.conversions, compact_cloud ─▶ PointCloud
      ─ ops.heading, ops.voxelize ─▶ SparseTensor
      ─ models ─▶ Features ─ matching ─▶ Correspondences
      ─ estimation ─▶ Registration (T_target_source, accepted) ─ gcl_ros ─▶ TransformStamped

Training branches off at Features: data.groups ─▶ PositiveGroups ─▶ losses ─▶ training.
Evaluation branches off at Registration: evaluation.plan ─▶ runner ─▶ score ─▶ report.
`registrar.py` is the whole of it on one page. Nothing here imports rclpy.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gcl_core.api import register
    from gcl_core.errors import GclError
    from gcl_core.registrar import Registrar, RegistrarConfig
    from gcl_core.types import PointCloud, Registration

# setup.py reads it here; a test holds package.xml, CITATION.cff and the changelog to it.
__version__ = '0.1.0'

# Threads that wait sleep instead of spinning: the cores are free for the rest of the robot. With a
# load of 5 on two cores, one description by two threads took 46 to 52 ms of processor time, 65 to
# 80 where they spun 10,000 times first (GOMP_SPINCOUNT), 108 to 121 with 30,000, 139 to 297 with
# OpenMP's default (medians of a process each, AMD EPYC Zen 4). OpenMP reads it when torch is
# loaded: a program that imports torch before this package has to set it itself.
os.environ.setdefault('OMP_WAIT_POLICY', 'PASSIVE')

_HOME = {  # module of each name; loaded when it is first asked for, since torch takes seconds
    'register': 'api',
    'Registrar': 'registrar',
    'RegistrarConfig': 'registrar',
    'PointCloud': 'types',
    'Registration': 'types',
    'GclError': 'errors',
}
__all__ = ['GclError', 'PointCloud', 'Registrar', 'RegistrarConfig', 'Registration', 'register']


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_HOME[name]}'), name)
