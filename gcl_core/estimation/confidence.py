"""How far a registration can be trusted: probability of being right, covariance.

The numbers come from simulated pairs (`python -m gcl_core.evaluation.calibrate`) and lie in a
JSON file beside the weights that they were found with.
"""

from __future__ import annotations

import json
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from gcl_core.config import from_mapping, read_json
from gcl_core.errors import GclError
from gcl_core.estimation.evidence import COLUMNS
from gcl_core.files import write_text

REMEDY = 'write it with `python -m gcl_core.evaluation.calibrate`'
TRUST_COLUMNS = 3  # see `Calibration.trust`


@dataclass(frozen=True)
class Judge:
    """Logistic regression.

    Attributes:
        weight: of each column.
        bias: log odds when all columns are 0.
    """

    weight: tuple[float, ...]
    bias: float

    def log_odds(self, columns: Float[torch.Tensor, 'h c']) -> Float[torch.Tensor, ' h']:
        """Log odds that each row is right."""
        return columns.double() @ torch.tensor(self.weight, dtype=torch.float64) + self.bias


@dataclass(frozen=True)
class Spread:
    """What turns GICP's information matrix into a covariance.

    GICP counts each point as independent evidence; neighbouring points are not, and both scans
    bend a little. Hence a factor on its inverse, and a floor.

    Attributes:
        factor: on the inverse of the information matrix.
        floor: standard deviation of each translation, metres.
        floor_deg: standard deviation of each rotation, degrees.
    """

    factor: float
    floor: float
    floor_deg: float

    def covariance(self, information: Float[np.ndarray, '6 6']) -> Float[np.ndarray, '6 6']:
        """Covariance in the order and frame of the information matrix; positive definite."""
        values, vectors = np.linalg.eigh(0.5 * (information + information.T))
        inverse = (vectors / np.maximum(values, 1e-3)) @ vectors.T
        floors = [self.floor**2] * 3 + [np.deg2rad(self.floor_deg) ** 2] * 3
        covariance = self.factor * inverse + np.diag(floors)
        return 0.5 * (covariance + covariance.T)


@dataclass(frozen=True)
class Calibration:
    """All fitted numbers.

    Attributes:
        rank: judges hypotheses as estimated, by `evidence.COLUMNS`.
        fine: judges them as refined, by the same columns.
        trust: judges the winner by its log odds, its lead over the best other place in log odds,
            and its lead in supporting correspondences (log), each through tanh.
        spread: of the transform.
    """

    rank: Judge
    fine: Judge
    trust: Judge
    spread: Spread


def load_calibration(path: Path) -> Calibration:
    """Read what the calibration command wrote.

    Raises:
        GclError: missing or malformed.
    """
    content = read_json(path, REMEDY)
    if isinstance(content, dict):
        content.pop('record', None)
    calibration = from_mapping(Calibration, content, str(path))
    judges = {'rank': len(COLUMNS), 'fine': len(COLUMNS), 'trust': TRUST_COLUMNS}
    for name, columns in judges.items():
        judge: Judge = getattr(calibration, name)
        if len(judge.weight) != columns:
            raise GclError(
                f'{path}: {name} weighs {len(judge.weight)} columns of evidence, this version has '
                f'{columns}; {REMEDY}'
            )
        if not np.isfinite([*judge.weight, judge.bias]).all():
            raise GclError(f'{path}: a number of {name} is not finite; {REMEDY}')
    if not np.isfinite([*astuple(calibration.spread)]).all():
        raise GclError(f'{path}: a number of spread is not finite; {REMEDY}')
    return calibration


def save_calibration(path: Path, calibration: Calibration, record: dict[str, Any]) -> None:
    """Write fitted numbers and where they come from."""
    write_text(path, json.dumps({**asdict(calibration), 'record': record}, indent=1) + '\n')


def fit_judge(
    columns: Float[torch.Tensor, 'n c'],
    right: Float[torch.Tensor, ' n'],
    *,
    signs: tuple[int, ...],
    weight: Float[torch.Tensor, ' n'] | None = None,
    ridge: float = 1e-3,
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
    """
    x = columns.double()
    mean, scale = x.mean(0), x.std(0).clamp(min=1e-9)
    x = torch.cat([(x - mean) / scale, torch.ones(len(x), 1, dtype=torch.float64)], 1)
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
