"""What a scan consists of: points, voxels and their neighbours by range; overlap; groups."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64

from gcl_core.data.sequence import Sequence
from gcl_core.evaluation.neighborhood import MAX_RANGE, VOXEL, neighborhood
from gcl_core.ops.kernel_map import CUBE_3, search
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud

RINGS = np.arange(0.0, MAX_RANGE + 1, 10.0)  # edges of the range rings, metres


@dataclass(frozen=True)
class ScanStatistics:
    """Counts of one scan in rings of 10 m around the sensor, up to 80 m.

    Attributes:
        points: returns in each ring.
        voxels: occupied voxels of 0.3 m in each ring.
        neighbors: occupied among the 27 voxels of a 3 x 3 x 3 block, its centre among them: mean
            in each ring, NaN where a ring is empty.
        mean_neighbors: the same over all voxels.
    """

    points: Int64[np.ndarray, ' k']
    voxels: Int64[np.ndarray, ' k']
    neighbors: Float[np.ndarray, ' k']
    mean_neighbors: float


def measure(cloud: PointCloud) -> ScanStatistics:
    """Count points, voxels and occupied neighbours by range."""
    tensor = voxelize([cloud], voxel_size=VOXEL, max_range=MAX_RANGE)
    found = search(tensor.keys, tensor.keys, CUBE_3)
    occupied = (found < len(tensor.keys)).sum(0).numpy().astype(float)
    distance = torch.linalg.norm(tensor.points, dim=1).numpy()
    voxels = np.histogram(distance, RINGS)[0]
    total = np.histogram(distance, RINGS, weights=occupied)[0]
    with np.errstate(invalid='ignore'):
        neighbors = total / voxels
    points = np.histogram(np.linalg.norm(cloud.points, axis=1), RINGS)[0]
    return ScanStatistics(points, voxels, neighbors, float(occupied.mean()))


@dataclass(frozen=True)
class GroupStatistics:
    """Positive groups of a centre scan.

    Attributes:
        scans: indices, the centre first.
        share: of the centre's points (one for each voxel) that form a group.
        mean_size: members of a group.
    """

    scans: tuple[int, ...]
    share: float
    mean_size: float


def group_statistics(sequence: Sequence, centre: int, seed: int = 0) -> GroupStatistics:
    """Draw a centre's neighbours and find its groups, as training does.

    Raises:
        GclError: the sequence has no such scan, or none within 60 m of it.
    """
    place = neighborhood(sequence, centre, np.random.default_rng(seed))
    groups = place.groups()
    sizes = groups.sizes.double()
    return GroupStatistics(
        place.scans,
        len(groups) / max(len(place.points[0]), 1),
        float(sizes.mean()) if len(groups) else 0.0,
    )


def every(sequence: Sequence, count: int) -> list[int]:
    """Indices of up to `count` scans spread over a sequence."""
    return sorted({int(i) for i in np.linspace(0, len(sequence) - 1, count)})
