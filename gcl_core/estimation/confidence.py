"""How far a registration can be trusted: probability of being right, covariance.

The numbers come from simulated pairs (`python -m gcl_core.evaluation.calibrate`) and lie in a
JSON file beside the weights that they were found with. `fit_judges.py` finds them.
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
TRUST_COLUMNS = 3  # see `decision.summary`
LEAST_RESIDUAL = 0.02  # the residual of a noise-free sensor is not less


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
        weight = torch.tensor(self.weight, dtype=torch.float64)
        return (columns.double() * weight).sum(1) + self.bias


@dataclass(frozen=True)
class Spread:
    """What turns GICP's information matrix into a covariance.

    GICP counts each point as independent evidence; neighbouring points are not, and a sweep that
    was bent by motion is bent along the ground. Hence a factor on its inverse, a floor, less of
    both upright (z, roll, pitch), and more of all where the aligned surfaces do not agree.

    Attributes:
        factor: on the inverse of the information matrix.
        floor: standard deviation of x and y, metres.
        floor_deg: standard deviation of the rotation about z, degrees.
        upright: share of standard deviations that z, roll and pitch have.
        power: of GICP's residual, by which all variances are multiplied.
    """

    factor: float
    floor: float
    floor_deg: float
    upright: float
    power: float

    def covariance(
        self, information: Float[np.ndarray, '*n 6 6'], residual: Float[np.ndarray, '*n'] | float
    ) -> Float[np.ndarray, '*n 6 6']:
        """Covariance in the order and frame of the information matrix; positive definite.

        Args:
            information: x y z rot_x rot_y rot_z.
            residual: mean squared, in units of the points' covariances.
        """
        values, vectors = np.linalg.eigh(0.5 * (information + information.swapaxes(-1, -2)))
        inverse = (vectors / np.maximum(values, 1e-3)[..., None, :]) @ vectors.swapaxes(-1, -2)
        flat = np.array([1, 1, self.upright, self.upright, self.upright, 1])
        floors = flat * np.array([self.floor] * 3 + [np.deg2rad(self.floor_deg)] * 3)
        inflation = np.maximum(residual, LEAST_RESIDUAL) ** self.power
        covariance = self.factor * flat[:, None] * inverse * flat + np.diag(floors**2)
        covariance = np.asarray(inflation)[..., None, None] * covariance
        return np.asarray(0.5 * (covariance + covariance.swapaxes(-1, -2)))


@dataclass(frozen=True)
class Stage:
    """Judges of hypotheses by `evidence.COLUMNS`.

    What tells a wrong place from the right one of the same pair is not what tells pairs apart:
    among repeated facades a parked car in space seen through decides, between streets surfaces do.

    Attributes:
        fit: whether a hypothesis is right, looked at alone.
        choice: which hypothesis of a pair is right if one is; only differences count.
    """

    fit: Judge
    choice: Judge


@dataclass(frozen=True)
class Trust:
    """Probability that a winner is right: that it fits, and that no other place is meant.

    Neither makes up for the other: among repeated facades every wrong place fits.

    Attributes:
        fits: judges by the first column of `decision.summary`.
        only: judges by the others, the leads.
    """

    fits: Judge
    only: Judge

    def probability(self, columns: Float[torch.Tensor, 'n 3']) -> Float[torch.Tensor, ' n']:
        """Product of both."""
        fits, only = self.fits.log_odds(columns[:, :1]), self.only.log_odds(columns[:, 1:])
        return fits.sigmoid() * only.sigmoid()


@dataclass(frozen=True)
class MadeWith:
    """What a calibration was made with; it holds for nothing else.

    Attributes:
        weights: SHA-256 of their file.
        settings: hash of what happens between description and judgement.
    """

    weights: str
    settings: str


@dataclass(frozen=True)
class Calibration:
    """Fitted numbers that come with weights.

    Attributes:
        estimated: judges hypotheses as estimated.
        refined: judges them as refined.
        gate: log odds of `estimated.fit` below which nothing is refined: no right one was lower.
        trust: judges the winner by its log odds, its lead over the other finalist, and its lead
            over every other place as estimated, each through tanh.
        spread: of the transform.
        made_with: None if nothing tells.
    """

    estimated: Stage
    refined: Stage
    gate: float
    trust: Trust
    spread: Spread
    made_with: MadeWith | None = None


def load_calibration(path: Path) -> Calibration:
    """Read what the calibration command wrote.

    Raises:
        GclError: missing, malformed, or of a version that calibrated key points apart.
    """
    content = read_json(path, REMEDY)
    if isinstance(content, dict):
        content.pop('record', None)
        if 'whole' in content or 'thin' in content:
            raise GclError(
                f"{path} has the keys 'whole' and 'thin' of an older version; this version "
                f'has one calibration for all scans; {REMEDY}'
            )
    calibration = from_mapping(Calibration, content, str(path))
    _check(calibration, str(path))
    return calibration


def _check(calibration: Calibration, where: str) -> None:
    """Refuse judges of other evidence than this version's, and numbers that are none.

    Raises:
        GclError: names the judge.
    """
    stages = {'estimated': calibration.estimated, 'refined': calibration.refined}
    judges = {
        f'{name}.{part}': (getattr(stage, part), len(COLUMNS))
        for name, stage in stages.items()
        for part in ('fit', 'choice')
    }
    judges['trust.fits'] = calibration.trust.fits, 1
    judges['trust.only'] = calibration.trust.only, TRUST_COLUMNS - 1
    for name, (judge, columns) in judges.items():
        if len(judge.weight) != columns:
            raise GclError(
                f'{where}: {name} weighs {len(judge.weight)} columns of evidence, this version '
                f'has {columns}; {REMEDY}'
            )
        if not np.isfinite([*judge.weight, judge.bias]).all():
            raise GclError(f'{where}: a number of {name} is not finite; {REMEDY}')
    if not np.isfinite([calibration.gate, *astuple(calibration.spread)]).all():
        raise GclError(f'{where}: gate or a number of spread is not finite; {REMEDY}')


def save_calibration(path: Path, fitted: Calibration, record: dict[str, Any]) -> None:
    """Write fitted numbers and where they come from."""
    write_text(path, json.dumps({**asdict(fitted), 'record': record}, indent=1) + '\n')
