"""What a scan consists of: points, voxels and their neighbours by range; overlap; groups."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64

from gcl_core import se3
from gcl_core.data.groups import draw_neighbors, find_groups
from gcl_core.data.sequence import Sequence, positions
from gcl_core.errors import GclError
from gcl_core.ops.kernel_map import search
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud

VOXEL, MAX_RANGE = 0.3, 80.0  # metres, as in the paper
RINGS = np.arange(0.0, MAX_RANGE + 1, 10.0)  # edges of the range rings, metres
RADIUS = 0.45  # metres between members of a group (the paper)
PHI = 6  # neighbour scans of a group (the paper)


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
    found = search(tensor.keys, tensor.keys, 3)
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
        GclError: the sequence has no such scan.
    """
    if not 0 <= centre < len(sequence):
        raise GclError(f'{sequence.name} has scans 0 to {len(sequence) - 1}, not {centre}')
    rng = np.random.default_rng(seed)
    scans = [centre, *draw_neighbors(positions(sequence), centre, PHI, rng)]
    tensor = voxelize([sequence.scan(i) for i in scans], voxel_size=VOXEL, max_range=MAX_RANGE)
    T_centre_world = se3.inverse(sequence.T_world_lidar(centre))
    T = np.stack([T_centre_world @ sequence.T_world_lidar(i) for i in scans])
    groups = find_groups(tensor.points, tensor.splits, T, radius=RADIUS)
    sizes = groups.sizes.double()
    return GroupStatistics(
        tuple(scans),
        len(groups) / max(tensor.splits[1], 1),
        float(sizes.mean()) if len(groups) else 0.0,
    )


def every(sequence: Sequence, count: int) -> list[int]:
    """Indices of up to `count` scans spread over a sequence."""
    return sorted({int(i) for i in np.linspace(0, len(sequence) - 1, count)})
