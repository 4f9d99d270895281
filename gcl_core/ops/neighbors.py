"""Radius neighbours: the points that a kernel of KPConv reaches (Thomas et al., ICCV 2019).

A k-d tree is the definition; a compiled grid search (native/radius.cpp) finds the same rows.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int32, Int64
from scipy.spatial import cKDTree

from gcl_core.errors import GclError
from gcl_core.ops.native.radius import radius_search


def radius_neighbors(
    queries: Float[torch.Tensor, 'm 3'],
    support: Float[torch.Tensor, 'n 3'],
    *,
    radius: float,
    limit: int,
) -> tuple[Int32[torch.Tensor, 'm k'], Int32[torch.Tensor, ' m']]:
    """Find the `limit` nearest of the support points within `radius` of each query.

    Args:
        queries: finite, metres.
        support: finite, metres.
        radius: metres.
        limit: columns of the table.

    Returns:
        Rows of the support points, nearest first, `len(support)` where there is none; and how
        many there are within the radius, also beyond the limit.

    Raises:
        GclError: radius or limit is not positive.
    """
    if radius <= 0 or limit < 1:
        raise GclError(f'radius is {radius} and limit {limit}; both must be positive')
    found = radius_search(queries, support, radius=radius, limit=limit)
    return _by_tree(queries, support, radius, limit) if found is None else found


def _by_tree(
    queries: torch.Tensor, support: torch.Tensor, radius: float, limit: int
) -> tuple[torch.Tensor, torch.Tensor]:
    if len(support) == 0 or len(queries) == 0:
        none = torch.zeros(len(queries), dtype=torch.int32)
        return none[:, None].expand(-1, limit).contiguous(), none
    tree, wanted = cKDTree(support.double().numpy()), queries.double().numpy()
    beyond = np.nextafter(radius, np.inf)  # the bound itself is left out
    _, rows = tree.query(wanted, k=np.arange(1, limit + 1), distance_upper_bound=beyond)
    counts = tree.query_ball_point(wanted, radius, return_length=True)
    return torch.from_numpy(rows.astype(np.int32)), torch.from_numpy(counts.astype(np.int32))


def nearest(
    queries: Float[torch.Tensor, 'm 3'], support: Float[torch.Tensor, 'n 3'], *, radius: float
) -> Int64[torch.Tensor, ' m']:
    """Row of the nearest support point of each query; one must lie within `radius`."""
    return radius_neighbors(queries, support, radius=radius, limit=1)[0][:, 0].long()


def limit_of(counts: Int32[torch.Tensor, ' n'], keep: float = 0.8) -> int:
    """Neighbours to keep, so that a share `keep` of the points loses none (public code: 0.8)."""
    if len(counts) == 0 or not 0 < keep <= 1:
        raise GclError(f'{len(counts)} counts, keep is {keep}; give some, and keep from ]0, 1]')
    histogram = torch.bincount(counts)
    return max(1, int((histogram.cumsum(0) < keep * len(counts)).sum()))
