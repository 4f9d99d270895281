"""A centre scan with its neighbours, and the spots that they see together, as training does it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.group_index import WINDOW
from gcl_core.data.groups import draw_neighbors, find_groups, segments
from gcl_core.data.sequence import Sequence, positions
from gcl_core.errors import GclError
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud, PositiveGroups

VOXEL, MAX_RANGE = 0.3, 80.0  # metres, as in the paper
RADIUS = 0.45  # metres between members of a group (the paper)
PHI = 6  # neighbour scans of a group (the paper)
TRIED = 200  # scans looked at as centres


@dataclass(frozen=True)
class Neighborhood:
    """Scans of one place.

    Attributes:
        sequence: name of the drive.
        scans: index of each scan in it, the centre first.
        clouds: as recorded, each in its own frame.
        points: barycentre of each voxel of 0.3 m within 80 m, each scan in its own frame.
        T_centre_scan: pose of each scan in the centre's frame.
    """

    sequence: str
    scans: tuple[int, ...]
    clouds: tuple[PointCloud, ...]
    points: tuple[Float[torch.Tensor, 'n 3'], ...]
    T_centre_scan: Float[np.ndarray, 's 4 4']

    @property
    def distances(self) -> Float[np.ndarray, ' s']:
        """From the centre's sensor to each scan's, metres."""
        return np.asarray(np.linalg.norm(self.T_centre_scan[:, :3, 3], axis=1))

    def groups(self, partner: int | None = None) -> PositiveGroups:
        """Find the positive groups, or the positive pairs of the centre and one partner.

        Args:
            partner: place of a neighbour in `scans`; None takes all of them.
        """
        kept = list(range(len(self.scans))) if partner is None else [0, partner]
        parts = [self.points[i] for i in kept]
        splits = np.cumsum([0, *(len(part) for part in parts)])
        poses = self.T_centre_scan[kept]
        return find_groups(torch.cat(parts), tuple(splits.tolist()), poses, radius=RADIUS)


def neighborhood(sequence: Sequence, centre: int, rng: np.random.Generator) -> Neighborhood:
    """Draw and read a centre's neighbours.

    Raises:
        GclError: the sequence has no such scan, or no scan within 60 m of it.
    """
    if not 0 <= centre < len(sequence):
        raise GclError(f'{sequence.name} has scans 0 to {len(sequence) - 1}, not {centre}')
    neighbors = draw_neighbors(positions(sequence), centre, PHI, rng, window=WINDOW)
    if not neighbors:
        raise GclError(
            f'{sequence.name} has no scan within 60 m of scan {centre}; take a drive with more'
        )
    scans = (centre, *neighbors)
    clouds = tuple(sequence.scan(i) for i in scans)
    voxels = [voxelize([cloud], voxel_size=VOXEL, max_range=MAX_RANGE) for cloud in clouds]
    T_centre_world = se3.inverse(sequence.T_world_lidar(centre))
    poses = np.stack([T_centre_world @ sequence.T_world_lidar(i) for i in scans])
    return Neighborhood(sequence.name, scans, clouds, tuple(v.points for v in voxels), poses)


def centres(sequence: Sequence, count: int) -> list[int]:
    """Up to `count` scans, spread over those with neighbours in the most segments.

    On a long drive all six of [-60 m, 60 m] are filled, on a short one as many as there are.
    """
    where = positions(sequence)
    tried = np.unique(np.linspace(0, len(where) - 1, min(TRIED, len(where))).astype(int))
    filled = np.array(
        [sum(len(part) > 0 for part in segments(where, i, PHI, window=WINDOW)) for i in tried]
    )
    best = tried[filled == filled.max()]
    return [
        int(best[i]) for i in np.unique(np.linspace(0, len(best) - 1, count + 2).astype(int)[1:-1])
    ]


def neighborhoods(
    sequences: Mapping[str, Sequence], count: int, seed: int
) -> Iterator[Neighborhood]:
    """Draw about `count` neighbourhoods, as many of each drive, in random order.

    Raises:
        GclError: a sequence has no two scans within 60 m.
    """
    each = -(-count // max(len(sequences), 1))
    chosen = [(s, i) for s in sequences.values() for i in centres(s, each)]
    rng = np.random.default_rng([seed, 21])
    for place in rng.permutation(len(chosen))[:count]:
        sequence, centre = chosen[place]
        yield neighborhood(sequence, centre, rng)
