"""Whether probabilities and covariances keep what they say."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Bool, Float

from gcl_core.estimation.confidence import Calibration, Spread
from gcl_core.estimation.decision import Finalist, summary
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
        winners: finalists.
    """

    columns: Float[torch.Tensor, 'n 3']
    right: Bool[torch.Tensor, ' n']
    probability: Float[torch.Tensor, ' n']
    errors: Float[torch.Tensor, 'n 6']
    winners: list[Finalist]


def verdicts(trials: list[Trial], calibration: Calibration) -> Verdicts:
    """Judge trials anew."""
    columns, right, errors, winners = [], [], [], []
    for trial in trials:
        winner, row = summary(trial.finalists, calibration)
        place = next(i for i, f in enumerate(trial.finalists) if f is winner)
        columns.append(row)
        right.append(trial.strict[place])
        errors.append(trial.errors[place])
        winners.append(winner)
    stacked = torch.cat(columns)
    probability = calibration.trust.log_odds(stacked).sigmoid()
    walked = torch.tensor([w.refined.walked for w in winners])
    return Verdicts(
        stacked,
        torch.stack(right),
        torch.where(walked, 0.0, probability),
        torch.stack(errors),
        winners,
    )


def squared_errors(outcome: Verdicts, spread: Spread) -> Float[np.ndarray, ' n']:
    """Squared errors of right winners in units of their covariance (Mahalanobis)."""
    values = []
    for i, winner in enumerate(outcome.winners):
        if outcome.right[i] and not winner.refined.walked:
            error = outcome.errors[i].numpy()
            covariance = spread.covariance(winner.refined.information)
            values.append(float(error @ np.linalg.solve(covariance, error)))
    return np.array(values)


def fit_spread(trials: list[Trial], calibration: Calibration) -> Spread:
    """Choose factor and floors of most likelihood, then widen until 90 % of errors are covered."""
    outcome = verdicts(trials, calibration)
    best, least = Spread(1.0, 0.02, 0.05), np.inf
    for factor in np.geomspace(0.1, 1000, 13):
        for floor in np.geomspace(0.002, 0.1, 9):
            for floor_deg in np.geomspace(0.005, 0.3, 9):
                spread = Spread(float(factor), float(floor), float(floor_deg))
                cost = _trimmed_cost(outcome, spread)
                if cost < least:
                    best, least = spread, cost
    widen = np.quantile(squared_errors(outcome, best), 0.9) / LEVELS[0.9]
    return Spread(
        float(best.factor * widen),
        float(best.floor * np.sqrt(widen)),
        float(best.floor_deg * np.sqrt(widen)),
    )


def _trimmed_cost(outcome: Verdicts, spread: Spread) -> float:
    """Mean negative log likelihood of Student's t (4 degrees): heavy tails do not decide alone."""
    informations = np.stack([w.refined.information for w in outcome.winners])
    kept = np.array(
        [bool(r) and not w.refined.walked for r, w in zip(outcome.right, outcome.winners)]
    )
    informations, errors = informations[kept], outcome.errors.numpy()[kept]
    values, vectors = np.linalg.eigh(informations)
    inverse = (vectors / np.maximum(values, 1e-3)[:, None]) @ vectors.transpose(0, 2, 1)
    floors = [spread.floor**2] * 3 + [np.deg2rad(spread.floor_deg) ** 2] * 3
    covariance = spread.factor * inverse + np.diag(floors)
    square = (errors * np.linalg.solve(covariance, errors[..., None])[..., 0]).sum(1)
    likelihood = 0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * (4 + 6) * np.log1p(square / 4)
    return float(likelihood.mean())


def report(trials: list[Trial], calibration: Calibration) -> str:
    """Describe false accepts, refusals, calibration and coverage in a few lines."""
    outcome = verdicts(trials, calibration)
    p, right = outcome.probability, outcome.right
    lines = [f'{len(trials)} pairs, {int(right.sum())} with the right transform on top']
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
    square = squared_errors(outcome, calibration.spread)
    covered = ', '.join(
        f'{100 * level:g} %: {100 * np.mean(square <= limit):.0f} %'
        for level, limit in LEVELS.items()
    )
    lines.append(f'covariance covers {covered}; mean squared error {square.mean() / 6:.2f} of 1')
    errors = outcome.errors[right & (p >= ACCEPT)]
    rte, rre = errors[:, :3].norm(dim=1), errors[:, 3:].norm(dim=1).rad2deg()
    lines.append(
        f'median error of the accepted {float(rte.median()):.3f} m, {float(rre.median()):.3f} deg'
    )
    return '\n'.join(lines + _by_distance(trials, outcome))


def _by_distance(trials: list[Trial], outcome: Verdicts) -> list[str]:
    lines = []
    for kind in ('street', 'repeated'):
        for low, high in ((5, 20), (20, 30), (30, 40), (40, 50), (50, 999)):
            rows = [i for i, t in enumerate(trials) if t.kind == kind and low <= t.distance < high]
            if rows:
                listed = sum(bool(trials[i].right.any()) for i in rows)
                lines.append(
                    f'{kind} {low}-{high} m: {len(rows)} pairs, listed {listed}, on top '
                    f'{int(outcome.right[rows].sum())}, accepted right '
                    f'{int((outcome.right[rows] & (outcome.probability[rows] >= ACCEPT)).sum())}'
                )
    return lines
