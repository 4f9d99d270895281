"""`python -m gcl_core.evaluation.calibrate`: fit probability and covariance on simulated pairs.

Run it again whenever weights or anything before the judgement change:

    python -m gcl_core.evaluation.calibrate --weights gcl_conv --trials build/trials --worlds 150
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gcl_core.errors import GclError, bad_input_exits
from gcl_core.estimation.confidence import Calibration, Stage, save_calibration
from gcl_core.estimation.evidence import SIGNS
from gcl_core.estimation.fit_judges import fit_choice, fit_judge, fit_trust
from gcl_core.evaluation.encounters import encounters
from gcl_core.evaluation.reliability import fit_spread, joined, report, verdicts
from gcl_core.evaluation.trials import GATE_MARGIN, Trial, load_trials, save_trials
from gcl_core.files import check_writable, sha256
from gcl_core.models import zoo
from gcl_core.models.backbone import QUARTER_TURNS
from gcl_core.progress import progress
from gcl_core.registrar import Registrar, RegistrarConfig

REPEATED_WEIGHT = 1 / 3  # every fourth world repeats one house; fewer streets do
ALL_HEADINGS_EVERY = 5  # worlds: one at all headings, the others at quarter turns
FOLDS = 3  # of the worlds, each judged by what was fitted on the others
NO_GATE = -1e3  # log odds that nothing falls below
FIRST_WORLD = 700_000_000  # training takes worlds from its seed x 1,000,000 on


def collect(
    registrar: Registrar, folder: Path, first: int, last: int, limit: float = np.inf
) -> None:
    """Write the trials of each world to a file; those that are there already are kept."""
    import time

    check_writable(folder / 'world')
    began = time.monotonic()
    every = registrar.config.headings if registrar.model.config.align else 1
    for number in progress(range(first, last), unit='world'):
        path = folder / f'world_{number:05d}.safetensors'
        if path.exists():
            continue
        if time.monotonic() - began > limit:
            break
        headings = every if number % ALL_HEADINGS_EVERY == 1 else min(every, len(QUARTER_TURNS))
        registrar.config = replace(registrar.config, headings=headings)
        trials = list(encounters(registrar, FIRST_WORLD + number))
        save_trials(path, trials)


def fit(trials: list[Trial], start: Calibration) -> Calibration:
    """Fit all numbers, from the choice of hypotheses to the covariance."""
    signs = tuple(SIGNS.values())
    # Repeats look right one by one; it is the choice among them that tells them apart.
    single = [t for t in trials if t.kind != 'repeated']
    estimated = Stage(
        fit=fit_judge(
            torch.cat([t.columns for t in single]),
            torch.cat([t.right for t in single]).float(),
            signs=signs,
            weight=torch.cat([torch.full((len(t.right),), 1 / len(t.right)) for t in single]),
        ),
        choice=fit_choice(
            [(t.columns, t.right) for t in trials], signs=signs, weight=shares(trials)
        ),
    )
    finals = [(t, torch.stack([f.columns for f in t.finalists])) for t in trials if t.finalists]
    alone = [(t, columns) for t, columns in finals if t.kind != 'repeated']
    refined = Stage(
        fit=fit_judge(
            torch.cat([columns for _, columns in alone]),
            torch.cat([t.strict for t, _ in alone]).float(),
            signs=signs,
        ),
        choice=fit_choice(
            [(columns, t.strict) for t, columns in finals],
            signs=signs,
            weight=shares([t for t, _ in finals]),
        ),
    )
    calibration = replace(
        start, estimated=estimated, refined=refined, gate=NO_GATE, made_with=None
    )
    outcome = verdicts(trials, calibration)
    judged = torch.tensor([w is not None for w in outcome.winners])
    trust = fit_trust(outcome.columns[judged], outcome.right[judged])
    calibration = replace(calibration, trust=trust)
    calibration = replace(calibration, gate=lowest_right(trials, calibration) - GATE_MARGIN)
    return replace(calibration, spread=fit_spread(trials, calibration))


def shares(trials: list[Trial]) -> list[float]:
    """Weight of each trial where streets of one house must not count more than they come."""
    return [REPEATED_WEIGHT if t.kind == 'repeated' else 1.0 for t in trials]


def lowest_right(trials: list[Trial], calibration: Calibration) -> float:
    """Least log odds, as estimated, at which a right transform came out likely."""
    outcome = verdicts(trials, calibration)
    likely = (outcome.right & (outcome.probability > 0.5)).tolist()
    odds = [float(calibration.estimated.fit.log_odds(t.columns).max()) for t in trials]
    return min((o for o, kept in zip(odds, likely) if kept), default=NO_GATE)


def main() -> None:
    """Collect, report what holds on worlds that were not fitted, fit on all, write."""
    parser = argparse.ArgumentParser(prog='calibrate', description=__doc__)
    parser.add_argument('--weights', default=RegistrarConfig().weights, help='name or file')
    parser.add_argument('--trials', type=Path, required=True, help='folder; one in it by weights')
    parser.add_argument('--worlds', type=int, default=150, help='simulated worlds')
    parser.add_argument('--first', type=int, default=0, help='number of the first world')
    parser.add_argument('--seconds', type=float, default=np.inf, help='collect for so long')
    parser.add_argument('--out', type=Path, help='default: beside the weights')
    parser.add_argument('--collect-only', action='store_true', help='fit another time')
    o = parser.parse_args()
    with bad_input_exits('calibrate'):
        run(o)


def run(o: Any) -> None:
    """Run with parsed options."""
    out = o.out or zoo.own_calibration(o.weights)
    check_writable(out)
    registrar = Registrar(RegistrarConfig(weights=o.weights))
    trials = o.trials / sha256(zoo.weights_file(o.weights))[:12]
    collect(registrar, trials, o.first, o.first + o.worlds, o.seconds)
    if o.collect_only:
        return
    files = sorted(trials.glob('world_*.safetensors'))
    if len(files) < FOLDS:
        raise GclError(f'{len(files)} worlds of trials in {trials}; {FOLDS} are the fewest')
    worlds = [load_trials(path) for path in files]
    figures = cross_validated(worlds, registrar.calibration)
    print(figures)
    everything = [t for world in worlds for t in world]
    record = {
        'worlds': len(worlds),
        'trials': len(everything),
        'cross_validated': figures.splitlines(),
    }
    fitted = replace(fit(everything, registrar.calibration), made_with=registrar.made_with)
    save_calibration(out, fitted, record)
    print(f'wrote {out}')


def cross_validated(worlds: list[list[Trial]], start: Calibration) -> str:
    """Judge the trials of each world by what was fitted on other worlds, and report."""
    seen: list[Trial] = []
    outcomes = []
    # Drawn, since what a world is follows from its number: a tunnel, say, is every twelfth.
    folds = np.random.default_rng(0).permutation(len(worlds)) % FOLDS
    for fold in range(FOLDS):
        fitted = fit([t for f, w in zip(folds, worlds) if f != fold for t in w], start)
        own = [t for f, w in zip(folds, worlds) if f == fold for t in w]
        if own:
            seen += own
            outcomes.append(verdicts(own, fitted))
    return report(seen, joined(outcomes))


if __name__ == '__main__':
    main()
