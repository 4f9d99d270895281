"""The positives of a centre scan, taken pair by pair and in groups from the same scans."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from gcl_core.data.groups import with_most
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError
from gcl_core.evaluation.neighborhood import VOXEL, Neighborhood, neighborhoods
from gcl_core.types import PositiveGroups

KINDS = ('pair-wise', 'group-wise')
NEAREST_PARTNER = 5.0  # metres; the paper's pairs begin there
Ranges = Float[np.ndarray, 'n 2']


@dataclass(frozen=True)
class Positives:
    """What training takes as one spot around a centre scan.

    Attributes:
        place: the scans.
        partner: place in `place.scans` of the neighbour that makes the pair.
        pairs: spots that centre and partner see.
        groups: spots that the centre and any neighbour see.
    """

    place: Neighborhood
    partner: int
    pairs: PositiveGroups
    groups: PositiveGroups

    @property
    def b(self) -> float:
        """Distance between the sensors of the pair, metres: the b of equation 2."""
        return float(self.place.distances[self.partner])

    @property
    def h(self) -> float:
        """Median distance of the pair's spots from the line through both sensors, metres.

        The h of equation 2, of a line that runs amid the spots.
        """
        axis = self.place.T_centre_scan[self.partner, :3, 3] / max(self.b, 1e-9)
        spots = self.pairs.anchor.numpy()
        off = np.linalg.norm(spots - np.outer(spots @ axis, axis), axis=1)
        return float(np.median(off)) if len(off) else 0.0


def draw_positives(
    sequences: Mapping[str, Sequence], count: int, seed: int, *, apart: float | None = None
) -> Iterator[Positives]:
    """Draw centres with their neighbours, and one of these as the partner of the pair.

    Args:
        sequences: drives.
        count: of centres, or fewer where there are not so many scans.
        seed: of everything.
        apart: take the partner nearest to this distance, metres; None draws it from all those
            5 m away and more.

    Raises:
        GclError: a sequence has no two scans within 60 m, or they share no spot.
    """
    rng = np.random.default_rng([seed, 22])
    for place in neighborhoods(sequences, count, seed):
        distances = place.distances[1:]
        far = np.flatnonzero(distances >= NEAREST_PARTNER)
        if apart is not None or not len(far):
            partner = 1 + int(abs(distances - (apart or np.inf)).argmin())
        else:
            partner = 1 + int(rng.choice(far))
        yield Positives(place, partner, place.groups(partner), shared_spots(place))


def shared_spots(place: Neighborhood) -> PositiveGroups:
    """Find the positive groups of a centre.

    Raises:
        GclError: there is none.
    """
    groups = place.groups()
    if len(groups) == 0:
        raise GclError(
            f'no neighbour sees a point of scan {place.scans[0]} of {place.sequence}; '
            'check the poses'
        )
    return groups


def densest(place: Neighborhood, groups: PositiveGroups) -> PositiveGroups:
    """Take as finest of each group the observation of most returns, as the paper defines it.

    Returns belong to the nearest of the scan's voxels; of equal counts the one nearest to its
    sensor is taken.
    """
    returns = []
    for cloud, points in zip(place.clouds, place.points, strict=True):
        _, nearest = cKDTree(points.numpy()).query(cloud.points, distance_upper_bound=VOXEL)
        returns.append(np.bincount(nearest, minlength=len(points) + 1)[:-1])
    return with_most(groups, np.concatenate(returns))


def two_members(groups: PositiveGroups, rng: np.random.Generator) -> Ranges:
    """Sensor ranges of two random members of each group, as the loss PP draws them, metres."""
    sizes, start = groups.sizes.numpy(), groups.offsets[:-1].numpy()
    first = rng.integers(sizes)
    second = (first + rng.integers(1, sizes)) % sizes
    ranges = groups.sensor_range.numpy()
    return np.stack([ranges[start + first], ranges[start + second]], axis=1)
