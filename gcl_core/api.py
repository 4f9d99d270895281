"""Registration in one line of Python: `gcl_core.register(source, target)`."""

from __future__ import annotations

from functools import lru_cache
from os import PathLike
from pathlib import Path

import numpy as np

from gcl_core.data.clouds import read_cloud
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud, Registration

Cloud = PointCloud | np.ndarray | str | PathLike[str]


def register(source: Cloud, target: Cloud, *, registrar: Registrar | None = None) -> Registration:
    """Find the transform that maps source points into the target frame.

    Args:
        source: one LiDAR scan in its sensor's frame: an (n, 3) array of metres (further columns
            are ignored), a `PointCloud`, or a file that `gcl register` reads.
        target: likewise.
        registrar: holds the network and the settings; without one, the default is loaded once.

    Returns:
        `T_target_source`, and whether it is `accepted`; `probability`, `covariance`, `reason`.

    Raises:
        GclError: bad input; the message names it and the remedy.
    """
    clouds = {'source': as_cloud(source, 'source'), 'target': as_cloud(target, 'target')}
    return (registrar or _default()).register(**clouds)


def as_cloud(cloud: Cloud, name: str) -> PointCloud:
    """Make a `PointCloud` of what `register` takes.

    Raises:
        GclError: it is no cloud.
    """
    if isinstance(cloud, np.ndarray):
        return PointCloud.from_array(cloud, name)
    if isinstance(cloud, str | PathLike):
        return read_cloud(Path(cloud))
    PointCloud.check(cloud, name)
    return cloud


@lru_cache(maxsize=1)
def _default() -> Registrar:
    return Registrar()
