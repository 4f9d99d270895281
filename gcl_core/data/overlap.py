"""How much of one scan another one sees (paper, appendix, equation of the overlap O)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from gcl_core import se3
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud

VOXEL = 0.3  # metres, paper
RADIUS = 0.45  # metres, paper's delta
LOW = 0.3  # paper: LoKITTI and LoNuScenes hold the pairs with at most this overlap


def overlap(
    *, source: PointCloud, target: PointCloud, T_target_source: Float[np.ndarray, '4 4']
) -> float:
    """Share of the source's points with a target point within 0.45 m.

    Both are down-sampled before, to the barycentre of each 0.3 m voxel. Not symmetric.
    """
    tree = cKDTree(_thinned(target))
    moved = se3.transform(T_target_source, _thinned(source))
    distance, _ = tree.query(moved, distance_upper_bound=RADIUS)
    return float(np.isfinite(distance).mean())


def _thinned(cloud: PointCloud) -> Float[np.ndarray, 'n 3']:
    voxels = voxelize([cloud], voxel_size=VOXEL, max_range=np.inf)
    return np.asarray(voxels.points.double().numpy())
