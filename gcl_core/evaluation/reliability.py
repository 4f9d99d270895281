"""Whether probabilities and covariances keep what they say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Bool, Float

from gcl_core.errors import GclError
from gcl_core.estimation.confidence import Calibration, Spread
from gcl_core.estimation.decision import Finalist, nothing_fits, summary
from gcl_core.evaluation import metrics
from gcl_core.evaluation.trials import Trial
from gcl_core.registrar import RegistrarConfig

ACCEPT = RegistrarConfig().min_probability
THRESHOLDS = (0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999)
LEVELS = {0.5: 5.348, 0.9: 10.645, 0.99: 16.812}  # quantiles of chi-square, 6 degrees of freedom


@dataclass(frozen=True)
class Verdicts:
    """The winner of each trial.

    Attributes:
        columns: what `Calibration.trust` judges.
        right: whether it meets the strict criterion.
        probability: that it does, as calibrated; 0 where refinement walked away.
        errors: six, about the target's axes.
        winners: finalists; None where nothing was worth refining.
        square: squared errors in units of their covariance (Mahalanobis); nan where wrong.
    """

    columns: Float[torch.Tensor, 'n 3']
    right: Bool[torch.Tensor, ' n']
    probability: Float[torch.Tensor, ' n']
    errors: Float[torch.Tensor, 'n 6']
    winners: list[Finalist | None]
    square: Float[np.ndarray, ' n']


def verdicts(trials: list[Trial], calibration: Calibration) -> Verdicts:
    """Judge trials anew."""
    columns, right, errors = [], [], []
    winners: list[Finalist | None] = []
    for trial in trials:
        if not trial.finalists or nothing_fits(trial.columns, calibration):
            columns.append(-torch.ones(1, 3))
            right.append(torch.tensor(False))
            errors.append(torch.full((6,), torch.inf, dtype=torch.float64))
            winners.append(None)
            continue
        winner, row = summary(trial.finalists, trial.columns, calibration)
        place = next(i for i, f in enumerate(trial.finalists) if f is winner)
        columns.append(row)
        right.append(trial.strict[place])
        errors.append(trial.errors[place])
        winners.append(winner)
    stacked = torch.cat(columns)
    probability = calibration.trust.probability(stacked)
    refused = torch.tensor([w is None or w.refined.walked or w.refined.slides for w in winners])
    outcome = Verdicts(
        columns=stacked,
        right=torch.stack(right),
        probability=torch.where(refused, 0.0, probability),
        errors=torch.stack(errors),
        winners=winners,
        square=np.full(len(trials), np.nan),
    )
    rows, found, information, residual = right_ones(outcome)
    outcome.square[rows] = _squares(found, calibration.spread.covariance(information, residual))
    return outcome


def joined(outcomes: list[Verdicts]) -> Verdicts:
    """Verdicts on several lists of trials as one."""
    return Verdicts(
        columns=torch.cat([o.columns for o in outcomes]),
        right=torch.cat([o.right for o in outcomes]),
        probability=torch.cat([o.probability for o in outcomes]),
        errors=torch.cat([o.errors for o in outcomes]),
        winners=[w for o in outcomes for w in o.winners],
        square=np.concatenate([o.square for o in outcomes]),
    )


def right_ones(
    outcome: Verdicts,
) -> tuple[list[int], np.ndarray, np.ndarray, np.ndarray]:
    """Rows, errors (n, 6), information matrices (n, 6, 6), residuals (n) of right winners."""
    rows = [
        i
        for i, winner in enumerate(outcome.winners)
        if outcome.right[i] and winner is not None and not winner.refined.walked
    ]
    refined = [w.refined for w in (outcome.winners[i] for i in rows) if w is not None]
    return (
        rows,
        outcome.errors[rows].numpy().reshape(-1, 6),
        np.array([r.information for r in refined]).reshape(-1, 6, 6),
        np.array([r.residual for r in refined]),
    )


def _squares(
    errors: Float[np.ndarray, 'n 6'], covariance: Float[np.ndarray, 'n 6 6']
) -> Float[np.ndarray, ' n']:
    return np.asarray((errors * np.linalg.solve(covariance, errors[..., None])[..., 0]).sum(1))


def fit_spread(trials: list[Trial], calibration: Calibration) -> Spread:
    """Find the numbers of most likelihood, then widen until 90 % of errors are covered."""
    from scipy.optimize import minimize

    _, errors, information, residual = right_ones(verdicts(trials, calibration))
    if len(errors) < 10:
        raise GclError(f'{len(errors)} right registrations are too few; collect more worlds')
    start = np.log([100.0, 0.02, 0.05, 0.5, 1.0])

    def cost(logs: np.ndarray) -> float:
        covariance = Spread(*np.exp(logs)).covariance(information, residual)
        # Student's t of 4 degrees: heavy tails do not decide alone. Its ridge keeps few apart.
        square = _squares(errors, covariance)
        likelihood = 0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * (4 + 6) * np.log1p(square / 4)
        return float(likelihood.mean() + 0.5 * ((logs - start) ** 2).mean() / len(errors))

    found = minimize(cost, start, method='Nelder-Mead', options={'maxiter': 1500})
    best = Spread(*(float(v) for v in np.exp(found.x)))
    square = _squares(errors, best.covariance(information, residual))
    widen = float(np.quantile(square, 0.9)) / LEVELS[0.9]
    return replace(
        best,
        factor=best.factor * widen,
        floor=best.floor * float(np.sqrt(widen)),
        floor_deg=best.floor_deg * float(np.sqrt(widen)),
    )


def report(trials: list[Trial], outcome: Verdicts) -> str:
    """Describe false accepts, refusals, calibration and coverage in a few lines."""
    p, right = outcome.probability, outcome.right
    skipped = sum(w is None for w in outcome.winners)
    lines = [f'{len(trials)} pairs, {int(right.sum())} right on top, {skipped} not refined']
    for threshold in THRESHOLDS:
        accepted = p >= threshold
        wrong, of = int((accepted & ~right).sum()), len(right)
        kept = int((accepted & right).sum())
        high = metrics.wilson(wrong, of)[1]
        lines.append(
            f'p >= {threshold:g}: {wrong} wrong of {of} pairs accepted (at most {100 * high:.2f} %'
            f' at 95 %), {100 * (1 - kept / max(1, int(right.sum()))):.1f} % of the right refused'
        )
    edges = [0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.01]
    for low, high in pairwise(edges):
        inside = (p >= low) & (p < high)
        if int(inside.sum()):
            lines.append(
                f'said {100 * float(p[inside].mean()):.1f} %: right '
                f'{100 * float(right[inside].double().mean()):.1f} % of {int(inside.sum())}'
            )
    lines.append(coverage(outcome.square[~np.isnan(outcome.square)]))
    errors = outcome.errors[right & (p >= ACCEPT)]
    rte, rre = errors[:, :3].norm(dim=1), errors[:, 3:].norm(dim=1).rad2deg()
    lines.append(
        f'median error of the accepted {float(rte.median()):.3f} m, {float(rre.median()):.3f} deg'
    )
    return '\n'.join(lines + _by_distance(trials, outcome))


def coverage(square: Float[np.ndarray, ' n']) -> str:
    """Describe how many squared errors lie within each quantile of chi-square."""
    covered = ', '.join(
        f'{100 * level:g} %: {100 * np.mean(square <= limit):.0f} %'
        for level, limit in LEVELS.items()
    )
    return f'covariance covers {covered}; mean squared error {square.mean() / 6:.2f} of 1'


def _by_distance(trials: list[Trial], outcome: Verdicts) -> list[str]:
    lines = []
    accepted = outcome.probability >= ACCEPT
    for kind in ('street', 'repeated'):
        for low, high in ((5, 20), (20, 30), (30, 40), (40, 50), (50, 999), (5, 50)):
            rows = [i for i, t in enumerate(trials) if t.kind == kind and low <= t.distance < high]
            if rows:
                right = outcome.right[rows]
                top, kept = int(right.sum()), int((right & accepted[rows]).sum())
                refused = ', '.join(f'{100 * p:.0f}' for p in metrics.wilson(top - kept, top))
                lines.append(
                    f'{kind} {low}-{high} m: {len(rows)} pairs, listed '
                    f'{sum(bool(trials[i].right.any()) for i in rows)}, on top {top}, accepted '
                    f'{kept}; of the right refused {refused} % at 95 %'
                )
    return lines
