"""Grid subsampling: one point, the barycentre, for each cell of a grid twice as coarse."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int64

from gcl_core.ops.voxelize import barycentres, coarsen


def grid_subsample(
    keys: Int64[torch.Tensor, ' n'], points: Float[torch.Tensor, 'n 3']
) -> tuple[Int64[torch.Tensor, ' m'], Float[torch.Tensor, 'm 3']]:
    """Merge the points of each cell of twice the size.

    Args:
        keys: sorted keys of the cells the points lie in, scan index in the top bits (see
            `gcl_core.ops.voxelize`).
        points: one point in each cell, metres.

    Returns:
        Sorted keys and barycentres of the occupied coarse cells.
    """
    coarse, parent = torch.unique(coarsen(keys), return_inverse=True)
    return coarse, barycentres(points, parent, len(coarse))
