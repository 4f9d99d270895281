"""All levels of a point U-Net over one batch of scans, and who is near whom within and between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import torch
from jaxtyping import Float, Int32, Int64

from gcl_core.ops.grid_subsample import grid_subsample
from gcl_core.ops.neighbors import nearest, radius_neighbors
from gcl_core.types import SparseTensor

# Points are rows: p @ QUARTERS[1] is p turned by 90 degrees, counter-clockwise seen from above.
QUARTERS = [
    torch.tensor([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    for c, s in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
]


@dataclass(frozen=True)
class PointPyramid:
    """What KPConv computes on; level i is a grid of 2^i times the first cell size.

    Attributes:
        features: input features of each point of level 0.
        points: of each level, finest first, metres, each scan in its own frame.
        splits: of each level; point i belongs to scan b when `splits[b] <= i < splits[b + 1]`.
        same: rows of the neighbours of each point in its own level, nearest first; the number of
            points of the level where there is none.
        down: neighbours in level i of each point of level i + 1, likewise.
        up: row in level i + 1 of the point nearest to each point of level i.
    """

    features: Float[torch.Tensor, 'n c']
    points: tuple[Float[torch.Tensor, 'n 3'], ...]
    splits: tuple[tuple[int, ...], ...]
    same: tuple[Int32[torch.Tensor, 'n k'], ...]
    down: tuple[Int32[torch.Tensor, 'm k'], ...]
    up: tuple[Int64[torch.Tensor, ' n'], ...]

    def to(self, device: torch.device) -> PointPyramid:
        """Copy to a device, or return itself if it is there."""
        if self.features.device == device:
            return self
        moved = {
            f.name: tuple(t.to(device) for t in getattr(self, f.name))
            for f in fields(self)
            if f.name not in ('features', 'splits')
        }
        return PointPyramid(self.features.to(device), splits=self.splits, **moved)

    def turned(self, quarters: int) -> PointPyramid:
        """Turn all points about the vertical by quarter turns; who is near whom stays."""
        turn = QUARTERS[quarters % 4].to(self.features)
        return replace(self, points=tuple(p @ turn for p in self.points))


def build_point_pyramid(
    voxels: SparseTensor, *, cell: float, reach: float, limits: Sequence[int]
) -> PointPyramid:
    """Subsample, and search within and between the levels.

    Args:
        voxels: of the first grid.
        cell: its size, metres.
        reach: radius of a neighbourhood in cells of the level.
        limits: most neighbours in each level; as many as there are levels.
    """
    keys, points, splits = [voxels.keys], [voxels.points], [voxels.splits]
    for _ in limits[1:]:
        coarse, centres = grid_subsample(keys[-1], points[-1])
        scan = torch.arange(len(voxels.splits), device=coarse.device)
        keys.append(coarse)
        points.append(centres)
        splits.append(tuple(torch.searchsorted(coarse >> 48, scan).tolist()))
    sizes = [cell * 2**level for level in range(len(limits))]
    levels = list(zip(points, splits, sizes, limits, strict=True))
    return PointPyramid(
        features=voxels.features,
        points=tuple(points),
        splits=tuple(splits),
        same=tuple(_neighbors(p, s, p, s, radius=reach * g, limit=k) for p, s, g, k in levels),
        down=tuple(
            _neighbors(coarse, own, p, s, radius=reach * g, limit=k)
            for (p, s, g, k), (coarse, own, *_) in pairwise(levels)
        ),
        up=tuple(
            # A coarse cell's barycentre is at most its diagonal away from each of its points.
            _nearest(p, s, coarse, own, radius=2 * g)
            for (p, s, _, _), (coarse, own, g, _) in pairwise(levels)
        ),
    )


def _neighbors(
    queries: torch.Tensor,
    query_splits: tuple[int, ...],
    support: torch.Tensor,
    splits: tuple[int, ...],
    *,
    radius: float,
    limit: int,
) -> torch.Tensor:
    """Search each scan by itself; rows count through all scans."""
    tables = []
    for (first, last), (a, b) in zip(pairwise(query_splits), pairwise(splits), strict=True):
        table, _ = radius_neighbors(queries[first:last], support[a:b], radius=radius, limit=limit)
        tables.append(torch.where(table < b - a, table + a, len(support)))
    return torch.cat(tables)


def _nearest(
    queries: torch.Tensor,
    query_splits: tuple[int, ...],
    support: torch.Tensor,
    splits: tuple[int, ...],
    *,
    radius: float,
) -> torch.Tensor:
    rows = [
        nearest(queries[first:last], support[a:b], radius=radius) + a
        for (first, last), (a, b) in zip(pairwise(query_splits), pairwise(splits), strict=True)
    ]
    return torch.cat(rows)
