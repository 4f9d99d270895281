"""Fit judges: logistic regressions whose weights keep the sign that makes sense."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float

from gcl_core.estimation.confidence import Judge, Trust


def fit_judge(
    columns: Float[torch.Tensor, 'n c'],
    right: Float[torch.Tensor, ' n'],
    *,
    signs: tuple[int, ...],
    weight: Float[torch.Tensor, ' n'] | None = None,
    ridge: float = 1e-3,
    constant: bool = True,
) -> Judge:
    """Fit a logistic regression whose weights keep the given signs.

    A column that would get the other sign is left out: on data unlike those of the fit, such a
    weight would count evidence for a transform against it.

    Args:
        columns: one row for each hypothesis.
        right: 1 where it is right.
        signs: 1 or -1 for each column, as it speaks for or against.
        weight: of each row; 1 by default.
        ridge: penalty on the weights of the standardised columns.
        constant: whether log odds are anything but 0 where all columns are 0.
    """
    x = columns.double()
    mean, scale = constant * x.mean(0), x.std(0).clamp(min=1e-9)
    one = torch.full((len(x), 1), float(constant), dtype=torch.float64)
    x = torch.cat([(x - mean) / scale, one], 1)
    w = torch.ones(len(x), dtype=torch.float64) if weight is None else weight.double()
    used = torch.ones(x.shape[1], dtype=torch.bool)
    while True:
        b = torch.zeros(x.shape[1], dtype=torch.float64)
        b[used] = _newton(x[:, used], right.double(), w / w.sum(), ridge)
        contrary = torch.tensor([*(b[:-1] * torch.tensor(signs) < 0).tolist(), False])
        if not bool(contrary.any()):
            break
        used &= ~contrary
    weights = b[:-1] / scale
    return Judge(tuple(weights.tolist()), float(b[-1] - (weights * mean).sum()))


def fit_choice(
    pairs: list[tuple[Float[torch.Tensor, 'h c'], Bool[torch.Tensor, ' h']]],
    *,
    signs: tuple[int, ...],
    weight: list[float],
) -> Judge:
    """Fit what tells the right hypothesis of a pair from its rivals (Bradley and Terry, 1952).

    Args:
        pairs: columns of the hypotheses of each pair of scans, and which are right; without a
            right or a wrong one, a pair says nothing.
        signs: as in `fit_judge`.
        weight: of each pair.
    """
    rows, share = [torch.empty(0, len(signs))], [torch.empty(0)]
    for (columns, right), w in zip(pairs, weight, strict=True):
        duels = (columns[right][:, None] - columns[~right]).flatten(0, 1)
        rows.append(duels)
        share.append(torch.full((len(duels),), w / max(1, len(duels))))
    ahead = torch.cat(rows)
    if len(ahead) < 2:
        return Judge((0.0,) * len(signs), 0.0)
    return fit_judge(
        ahead, torch.ones(len(ahead)), signs=signs, weight=torch.cat(share), constant=False
    )


def fit_trust(
    columns: Float[torch.Tensor, 'n 3'], right: Bool[torch.Tensor, ' n'], ridge: float = 2e-4
) -> Trust:
    """Fit the two judges whose product is the probability, together; weights are positive.

    Args:
        columns: as `decision.summary` gives them.
        right: whether the winner was.
        ridge: penalty on the weights.
    """
    from scipy.optimize import minimize

    def trust(numbers: np.ndarray) -> Trust:
        a, b, c = np.exp(numbers[:3]).tolist()
        return Trust(Judge((a,), float(numbers[3])), Judge((b, c), float(numbers[4])))

    def cost(numbers: np.ndarray) -> float:
        p = trust(numbers).probability(columns).clamp(1e-9, 1 - 1e-9)
        surprise = -torch.where(right, p.log(), (1 - p).log()).mean()
        return float(surprise) + ridge * float(np.exp(2 * numbers[:3]).sum())

    start = np.array([1.5, 1.5, 1.0, 0.5, -2.0])
    found = minimize(cost, start, method='Nelder-Mead', options={'maxiter': 2000, 'maxfev': 2000})
    return trust(found.x)


def _newton(
    x: Float[torch.Tensor, 'n c'],
    right: Float[torch.Tensor, ' n'],
    weight: Float[torch.Tensor, ' n'],
    ridge: float,
) -> Float[torch.Tensor, ' c']:
    """Most likely weights of a logistic regression; the last column is the constant."""
    penalty = torch.full((x.shape[1],), ridge, dtype=torch.float64)
    penalty[-1] = 1e-9
    b = torch.zeros(x.shape[1], dtype=torch.float64)
    for _ in range(200):
        p = torch.sigmoid(x @ b)
        gradient = x.t() @ (weight * (p - right)) + penalty * b
        curvature = x.t() @ ((weight * p * (1 - p)).unsqueeze(1) * x) + torch.diag(penalty)
        step = torch.linalg.solve(curvature + 1e-9 * torch.eye(len(b)), gradient)
        step = step * min(1.0, 2.0 / max(float(step.norm()), 1e-12))  # no overshooting far out
        b = b - step
        if float(step.norm()) < 1e-9:
            break
    return b
