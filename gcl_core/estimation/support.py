"""How much of the correspondences a transform explains, for many transforms at once.

Residuals are taken as they are, R p + t - q: the product that they can be brought into,
    |p|^2 + |q|^2 + |t|^2 + 2 (R^T t).p - 2 t.q - 2 sum R_ij q_i p_j,
takes the difference of numbers that float32 holds to a millimetre squared. The products weighted
by the inliers are the moments that a least-squares transform needs.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float

from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.procrustes import from_moments, products
from gcl_core.ops.native.support import LANES, support_scores
from gcl_core.ops.repeatable import moved, row_sums
from gcl_core.types import Correspondences

BLOCK = 1 << 17  # hypotheses x correspondences held at a time: they stay in the cache
LEAST_WEIGHT = 1e-6  # so that inliers that are not alike count where there are no others


class Support:
    """Scores transforms on one set of correspondences.

    Args:
        correspondences: negative weights count as 0.
        threshold: residual of an inlier, metres.
    """

    def __init__(self, correspondences: Correspondences, threshold: float) -> None:
        self._source = correspondences.source.float()
        self._target = correspondences.target.float().t().contiguous()
        self.weight = correspondences.weight.float().clamp(min=0)
        self._limit = threshold**2
        table = torch.cat([self._source.t(), self._target, self.weight[None]])
        self._table = torch.nn.functional.pad(table, (0, -len(self.weight) % LANES)).contiguous()
        self._products = products(self._source.double(), self._target.t().double())

    @property
    def total(self) -> float:
        """Sum of all weights."""
        return float(row_sums(self.weight[None]))

    def inliers(self, T: Float[torch.Tensor, 'h 4 4']) -> Bool[torch.Tensor, 'h n']:
        """Which correspondences each transform explains."""
        off = (moved(T.float(), self._source) - self._target).square_()
        return off[:, 0] + off[:, 1] + off[:, 2] < self._limit

    def scores(self, T: Float[torch.Tensor, 'h 4 4']) -> Float[torch.Tensor, ' h']:
        """Sum of the inliers' weights for each transform."""
        found = support_scores(T.float(), self._table, self._limit)
        return self._by_blocks(T) if found is None else found

    def _by_blocks(self, T: Float[torch.Tensor, 'h 4 4']) -> Float[torch.Tensor, ' h']:
        blocks = T.split(max(1, BLOCK // max(1, len(self.weight))))
        return torch.cat([self._score(self.inliers(block)) for block in blocks])

    def _score(self, inlier: Bool[torch.Tensor, 'h n']) -> Float[torch.Tensor, ' h']:
        return row_sums(torch.where(inlier, self.weight, 0.0))

    def polish(self, T: Float[torch.Tensor, 'h 4 4'], steps: int) -> list[Hypothesis]:
        """Re-estimate all six degrees of freedom from the inliers while the support grows."""
        if len(T) == 0:
            return []
        best, inlier = T.double(), self.inliers(T)
        score = self._score(inlier)
        for _ in range(steps):
            candidate = from_moments(self.moments(inlier))
            new_inlier = self.inliers(candidate)
            new_score = self._score(new_inlier)
            grown = (new_score > score) & (inlier.sum(1) >= 3)
            if not bool(grown.any()):
                break
            best = torch.where(grown[:, None, None], candidate, best)
            inlier = torch.where(grown[:, None], new_inlier, inlier)
            score = torch.where(grown, new_score, score)
        counts = inlier.sum(1).tolist()
        return [Hypothesis(t, s, n) for t, s, n in zip(best, score.tolist(), counts)]

    def moments(self, inlier: Bool[torch.Tensor, 'h n']) -> Float[torch.Tensor, 'h 17']:
        """Weighted sums of the inliers' products, float64, inlier by inlier."""
        row = inlier.nonzero()[:, 1]
        weight = (self.weight[row] + LEAST_WEIGHT).double()
        weighted = (self._products[row] * weight[:, None]).numpy()
        counts = inlier.sum(1).numpy()
        some = counts > 0
        sums = np.zeros((len(inlier), weighted.shape[1]))
        if some.any():
            sums[some] = np.add.reduceat(weighted, (np.cumsum(counts) - counts)[some], axis=0)
        return torch.from_numpy(sums)
