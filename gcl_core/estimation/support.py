"""How much of the correspondences a transform explains: one matrix product for all transforms.

The squared residual
    |R p + t - q|^2 = |p|^2 + |q|^2 + |t|^2 + 2 (R^T t).p - 2 t.q - 2 sum R_ij q_i p_j

is bilinear in (R, t) and (p, q). The same products, weighted by the inliers, are the moments that
a least-squares transform needs, so that many hypotheses are re-estimated at once.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float

from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.procrustes import from_moments, products
from gcl_core.types import Correspondences

BLOCK = 1 << 17  # hypotheses x correspondences held at a time: they stay in the cache


class Support:
    """Scores transforms on one set of correspondences.

    Args:
        correspondences: negative weights count as 0.
        threshold: residual of an inlier, metres.
    """

    def __init__(self, correspondences: Correspondences, threshold: float) -> None:
        self._table = products(correspondences.source.float(), correspondences.target.float())
        self._columns = self._table.t().contiguous()
        self.weight = correspondences.weight.float().clamp(min=0)
        self._limit = threshold**2

    def inliers(self, T: Float[torch.Tensor, 'h 4 4']) -> Bool[torch.Tensor, 'h n']:
        """Which correspondences each transform explains."""
        return (_rows(T.float()) @ self._columns) < self._limit

    def scores(self, T: Float[torch.Tensor, 'h 4 4']) -> Float[torch.Tensor, ' h']:
        """Sum of the inliers' weights for each transform."""
        step = max(1, BLOCK // max(1, len(self.weight)))
        rows, scores = _rows(T.float()), self.weight.new_empty(len(T))
        for i in range(0, len(T), step):
            residuals = rows[i : i + step] @ self._columns
            torch.mv(residuals.lt_(self._limit), self.weight, out=scores[i : i + step])
        return scores

    def polish(self, T: Float[torch.Tensor, 'h 4 4'], steps: int) -> list[Hypothesis]:
        """Re-estimate all six degrees of freedom from the inliers while the support grows."""
        if len(T) == 0:
            return []
        best, inlier, table = T.double(), self.inliers(T), self._table.double()
        score = inlier.float() @ self.weight
        for _ in range(steps):
            moments = (inlier * (self.weight + 1e-6)).double() @ table
            candidate = from_moments(moments)
            new_inlier = self.inliers(candidate)
            new_score = new_inlier.float() @ self.weight
            grown = (new_score > score) & (inlier.sum(1) >= 3)
            if not bool(grown.any()):
                break
            best = torch.where(grown[:, None, None], candidate, best)
            inlier = torch.where(grown[:, None], new_inlier, inlier)
            score = torch.where(grown, new_score, score)
        counts = inlier.sum(1).tolist()
        return [Hypothesis(t, s, n) for t, s, n in zip(best, score.tolist(), counts)]


def _rows(T: Float[torch.Tensor, 'h 4 4']) -> Float[torch.Tensor, 'h 17']:
    """Rows whose product with the table's columns are squared residuals."""
    rotation, t = T[:, :3, :3], T[:, :3, 3]
    back = (rotation.transpose(1, 2) @ t.unsqueeze(2)).squeeze(2)
    square = t.square().sum(1, keepdim=True)
    return torch.cat(
        [torch.ones_like(square), square, 2 * back, -2 * t, -2 * rotation.flatten(1)], 1
    )
