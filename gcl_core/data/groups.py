"""Group sampling: which scans are trained together, and which of their points are one spot.

Paper, sections "Overview of GCL" and "Positive Group Searching".
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.spatial import cKDTree

from gcl_core import se3
from gcl_core.types import PositiveGroups

REACH = 60.0  # metres; the paper's [-60 m, 60 m]


def segments(
    positions: Float[np.ndarray, 'n 3'],
    centre: int,
    phi: int,
    *,
    reach: float = REACH,
    window: int | None = None,
) -> list[Int64[np.ndarray, ' k']]:
    """Scans in each of `phi` equal segments of [-reach, reach], metres, around a centre scan.

    The signed coordinate is the straight distance, negative for earlier scans. `window` leaves out
    scans more than so many frames away.
    """
    first = 0 if window is None else max(0, centre - window)
    last = len(positions) if window is None else centre + window + 1
    distance = np.linalg.norm(positions[first:last] - positions[centre], axis=1)
    scans = first + np.arange(len(distance))
    signed = np.where(scans < centre, -distance, distance)
    edges = np.linspace(-reach, reach, phi + 1)
    return [
        scans[(signed >= low) & (signed < high) & (scans != centre)]
        for low, high in pairwise(edges)
    ]


def draw_neighbors(
    positions: Float[np.ndarray, 'n 3'],
    centre: int,
    phi: int,
    rng: np.random.Generator,
    *,
    reach: float = REACH,
    window: int | None = None,
) -> list[int]:
    """Draw one scan from each segment around a centre scan; see `segments`.

    A segment without scans is skipped, as at the ends of a drive.
    """
    filled = segments(positions, centre, phi, reach=reach, window=window)
    return [int(rng.choice(part)) for part in filled if len(part)]


def find_groups(
    points: Float[torch.Tensor, 'n 3'],
    splits: tuple[int, ...],
    T_centre_scan: Float[np.ndarray, 's 4 4'],
    *,
    radius: float,
    per_scan: int = 1,
) -> PositiveGroups:
    """Collect, for every point of scan 0, its neighbours in every other scan.

    Points without a neighbour in any other scan form no group.

    Args:
        points: points of all scans stacked, metres, each in its own frame.
        splits: where each scan begins and ends in `points`; scan 0 is the centre.
        T_centre_scan: pose of each scan in the centre's frame.
        radius: metres (the paper: 0.45).
        per_scan: most members taken from one scan, nearest first (public code: 5).

    Returns:
        Groups whose finest member is the one nearest to its own sensor.
    """
    own = points.double().numpy()
    aligned = [
        se3.transform(T, own[a:b])
        for T, a, b in zip(T_centre_scan, splits[:-1], splits[1:], strict=True)
    ]
    count = len(aligned[0])
    group, member = [np.arange(count)], [np.arange(count) + splits[0]]
    for scan in range(1, len(aligned)):
        tree = cKDTree(aligned[scan])
        _, index = tree.query(
            aligned[0], k=np.arange(1, per_scan + 1), distance_upper_bound=radius
        )
        row, column = np.nonzero(index < len(aligned[scan]))
        group.append(row)
        member.append(index[row, column] + splits[scan])
    all_groups, all_members = np.concatenate(group), np.concatenate(member)
    order = np.argsort(all_groups, kind='stable')
    all_groups, all_members = all_groups[order], all_members[order]
    sizes = np.bincount(all_groups, minlength=count)
    kept = sizes > 1
    in_kept = kept[all_groups]
    members = all_members[in_kept]
    offsets = np.concatenate([[0], np.cumsum(sizes[kept])])
    sensor_range = np.linalg.norm(own[members], axis=1)
    return PositiveGroups(
        offsets=torch.from_numpy(offsets),
        member=torch.from_numpy(members),
        sensor_range=torch.from_numpy(sensor_range),
        finest=torch.from_numpy(first_minimum(sensor_range, offsets)),
        anchor=torch.from_numpy(aligned[0][kept]),
    )


def densest(
    groups: PositiveGroups,
    points: Float[torch.Tensor, 'n 3'],
    splits: tuple[int, ...],
    radius: float = 1.2,
) -> PositiveGroups:
    """Take as finest of each group the member with most points of its scan around it (paper).

    Of equal counts the one nearest to its sensor is taken.

    Args:
        groups: among the points.
        points: of all scans stacked, each scan in its own frame, metres.
        splits: where each scan begins and the last ends.
        radius: within which points count, metres.
    """
    counts = []
    for a, b in pairwise(splits):
        scan = points[a:b].double().numpy()
        counts.append(cKDTree(scan).query_ball_point(scan, radius, return_length=True))
    return with_most(groups, np.concatenate(counts))


def with_most(groups: PositiveGroups, count: Int64[np.ndarray, ' n']) -> PositiveGroups:
    """Take as finest of each group the member of the largest count.

    Args:
        groups: among n points.
        count: of each point; of equal ones that nearest to its sensor is taken.
    """
    rank = groups.sensor_range.numpy() / 1e3 - count[groups.member.numpy()]  # ranges below 1 km
    return replace(groups, finest=torch.from_numpy(first_minimum(rank, groups.offsets.numpy())))


def first_minimum(value: Float[np.ndarray, ' n'], offsets: np.ndarray) -> np.ndarray:
    """Position of the smallest value in each segment."""
    segment = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    order = np.lexsort((value, segment))
    return np.asarray(order[offsets[:-1]])


def sample_groups(
    groups: PositiveGroups, count: int, generator: torch.Generator
) -> PositiveGroups:
    """Keep `count` random groups, or all if there are fewer."""
    chosen = torch.randperm(len(groups), generator=generator)[:count].sort().values
    sizes = groups.sizes[chosen]
    offsets = torch.cat([sizes.new_zeros(1), sizes.cumsum(0)])
    start = groups.offsets[chosen]
    row = torch.arange(int(offsets[-1])) + torch.repeat_interleave(start - offsets[:-1], sizes)
    return PositiveGroups(
        offsets=offsets,
        member=groups.member[row],
        sensor_range=groups.sensor_range[row],
        finest=groups.finest[chosen] - start + offsets[:-1],
        anchor=groups.anchor[chosen],
    )
