"""Hypothesise and verify: which of many hypotheses is right, and how likely it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from gcl_core.errors import GclError
from gcl_core.estimation.confidence import Calibration
from gcl_core.estimation.evidence import Scene, evidence
from gcl_core.estimation.hypothesis import Hypothesis, distinct
from gcl_core.estimation.refine import Prepared, RefineConfig, Refined, refine_all

NO_RIVAL = 20.0  # lead in log odds when no other place was found
HOPELESS = 6.0  # log odds behind the best hypothesis, beyond which refinement changes nothing
SATURATION = 5.0  # log odds beyond which more says little more: real scans differ from the fit's


@dataclass(frozen=True)
class VerifyConfig:
    """How hypotheses are checked.

    Attributes:
        hypotheses: distinct ones that are checked.
        finalists: the best of them, which are refined and checked again.
        tolerance: misalignment that is no conflict before refinement, metres.
        fine_tolerance: likewise after it.
    """

    hypotheses: int = 32
    finalists: int = 2
    tolerance: float = 1.0
    fine_tolerance: float = 0.5

    def __post_init__(self) -> None:
        if not 1 <= self.finalists <= self.hypotheses:
            raise GclError(
                f'verify.finalists is {self.finalists}; it must be at least 1 and at most '
                f'verify.hypotheses ({self.hypotheses})'
            )


@dataclass(frozen=True)
class Finalist:
    """A refined hypothesis.

    Attributes:
        refined: its transform.
        columns: evidence as refined.
        inliers: correspondences that agreed before refinement.
        row: the hypothesis that was refined.
        rivals: which hypotheses are of another place than the refined one.
    """

    refined: Refined
    columns: Float[torch.Tensor, ' 10']
    inliers: int
    row: int
    rivals: Bool[torch.Tensor, ' h']


def stacked(hypotheses: list[Hypothesis]) -> Float[torch.Tensor, 'h 4 4']:
    """Transforms of hypotheses."""
    return torch.stack([h.T_target_source for h in hypotheses])


def examine(
    hypotheses: list[Hypothesis], scene: Scene, config: VerifyConfig
) -> Float[torch.Tensor, 'h 10']:
    """Evidence on hypotheses as they were estimated."""
    support = torch.tensor([h.inliers for h in hypotheses])
    return evidence(stacked(hypotheses), support, scene, tolerance=config.tolerance)


def refine_finalists(
    hypotheses: list[Hypothesis],
    odds: Float[torch.Tensor, ' h'],
    scene: Scene,
    *,
    source: Prepared,
    target: Prepared,
    verify: VerifyConfig,
    config: RefineConfig,
) -> list[Finalist]:
    """Refine the best hypotheses and look at the evidence again; what became one place comes once.

    Args:
        hypotheses: all that were found.
        odds: log odds of each.
        scene: for the checks.
        source: for GICP.
        target: for GICP.
        verify: how many, and the tolerance of the checks.
        config: of GICP.
    """
    rows = odds.argsort(descending=True)[: verify.finalists]
    chosen = [hypotheses[i] for i in rows.tolist()]
    starts = [h.T_target_source.numpy() for h in chosen]
    hopeful = int((odds[rows] > odds[rows[0]] - HOPELESS).sum())
    refined = refine_all(starts[:hopeful], source=source, target=target, config=config)
    refined += [Refined(T, np.eye(6), walked=True) for T in starts[hopeful:]]
    after = torch.from_numpy(np.stack([r.T_target_source for r in refined]))
    support = torch.tensor([h.inliers for h in chosen])
    columns = evidence(after, support, scene, tolerance=verify.fine_tolerance)
    finalists, apart = [], distinct(after, after)
    for i, r in enumerate(refined):
        if bool(apart[i, :i].all()):
            rivals = distinct(stacked(hypotheses), after[i : i + 1])[:, 0]
            finalists.append(Finalist(r, columns[i], chosen[i].inliers, int(rows[i]), rivals))
    return finalists


def nothing_fits(examined: Float[torch.Tensor, 'h 10'], calibration: Calibration) -> bool:
    """Whether no hypothesis looks right enough to be worth refining."""
    return float(calibration.estimated.fit.log_odds(examined).max()) < calibration.gate


def summary(
    finalists: list[Finalist], examined: Float[torch.Tensor, 'h 10'], calibration: Calibration
) -> tuple[Finalist, Float[torch.Tensor, '1 3']]:
    """The winner, and what `Calibration.trust` judges it by.

    Args:
        finalists: at least one.
        examined: evidence on all hypotheses as estimated.
        calibration: fitted numbers.
    """
    columns = torch.stack([f.columns for f in finalists])
    choice = calibration.refined.choice.log_odds(columns)
    first = int(choice.argmax())
    winner = finalists[first]
    others = torch.cat([choice[:first], choice[first + 1 :]])
    before = calibration.estimated.choice.log_odds(examined)
    numbers = [
        float(calibration.refined.fit.log_odds(columns[first : first + 1])),
        float(choice[first] - others.max()) if len(others) else NO_RIVAL,
        float(before[winner.row] - before[winner.rivals].max())
        if bool(winner.rivals.any())
        else NO_RIVAL,
    ]
    return winner, torch.tensor([[math.tanh(number / SATURATION) for number in numbers]])
