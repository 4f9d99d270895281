"""How alike the features are of what a transform brings together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64

from gcl_core.estimation.surface import SOLID_HEIGHT, grid_cell, grid_shape, neighbors
from gcl_core.matching.keypoints import spread
from gcl_core.ops.ground import height_above_ground
from gcl_core.ops.repeatable import gram, moved, product
from gcl_core.types import Features, Heading

CELL = 1.0  # metres; two key points in one cell, or in neighbouring ones, lie together
CHECKED = 1500  # key points of a scan that are checked, spread in space


def raised_rows(points: Float[torch.Tensor, 'n 3']) -> Int64[torch.Tensor, ' k']:
    """Which key points lie above the ground; ground looks like ground wherever it lies."""
    scan = torch.zeros(len(points), dtype=torch.long)
    return torch.nonzero(height_above_ground(points, scan) > SOLID_HEIGHT).squeeze(1)


def raised(headings: Sequence[Heading]) -> list[Heading]:
    """Keep at most `CHECKED` key points of each heading, above the ground and spread in space."""
    kept: list[Heading] = []
    points, rows = None, torch.empty(0, dtype=torch.long)
    for heading in headings:
        features = heading.features
        if features.points is not points:  # headings of one description share their key points
            points = features.points
            rows = raised_rows(points)
            rows = rows[spread(points[rows], CHECKED)]
        chosen = Features(features.points[rows], features.descriptors[rows].float())
        kept.append(Heading(heading.yaw, chosen))
    return kept


@dataclass(frozen=True)
class KeypointGrid:
    """The raised key points of a target by place, and what its descriptors look like on average.

    Attributes:
        features: raised key points.
        row: key point in or beside each cell; -1 without any.
        mean: of the descriptors.
        covariance: of the descriptors.
    """

    features: Features
    row: Int64[torch.Tensor, ' cells']
    mean: Float[torch.Tensor, ' d']
    covariance: Float[torch.Tensor, 'd d']


def keypoint_grid(features: Features) -> KeypointGrid:
    """Index a target's key points."""
    rows = raised_rows(features.points)
    kept = Features(features.points[rows], features.descriptors[rows].float())
    row = torch.full((math.prod(grid_shape(CELL)),), -1)
    cell, inside = grid_cell(kept.points.t(), CELL)
    index, cell = torch.nonzero(inside).squeeze(1), cell[inside]
    around = neighbors(CELL)
    beside = around[around[:, :3].abs().sum(1) == 1, 3]
    # Among equally near ones the last key point wins, whatever the threads do.
    row.scatter_reduce_(0, (cell + beside[:, None]).flatten(), index.repeat(len(beside)), 'amax')
    row[cell] = -1
    row.scatter_reduce_(0, cell, index, 'amax')
    count = max(1, len(kept))
    mean = gram(torch.ones(len(kept), 1), kept.descriptors)[0] / count
    centred = kept.descriptors - mean
    return KeypointGrid(kept, row, mean, gram(centred, centred) / count)


def likeness(
    T_target_source: Float[torch.Tensor, 'h 4 4'], source: Features, target: KeypointGrid
) -> tuple[Float[torch.Tensor, ' h'], Float[torch.Tensor, ' h']]:
    """Mean standard score of the similarities of key points that lie together, and their number.

    The score says how many standard deviations more alike two descriptors are than the source's
    and a random one of the target: 0 by chance.
    """
    cell, inside = grid_cell(moved(T_target_source.float(), source.points), CELL)
    row = target.row[cell]
    met = inside & (row >= 0)
    h, p = met.nonzero(as_tuple=True)
    d = source.descriptors
    expected = (d * target.mean).sum(1)
    deviation = (product(d, target.covariance) * d).sum(1).clamp(min=1e-6).sqrt()
    similarity = (d[p] * target.features.descriptors[row[h, p]]).sum(1)
    score = (similarity - expected[p]) / deviation[p]
    count = met.sum(1).float()
    total = torch.zeros(len(T_target_source)).index_add_(0, h, score)
    return total / count.clamp(min=1), count
