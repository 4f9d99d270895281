"""`python -m gcl_core.evaluation.calibrate`: fit probability and covariance on simulated pairs.

Run it again whenever weights or anything before the judgement change:

    python -m gcl_core.evaluation.calibrate --weights gcl_conv --trials build/trials --worlds 150
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from gcl_core.errors import GclError
from gcl_core.estimation.confidence import Calibration, fit_judge, save_calibration
from gcl_core.estimation.evidence import SIGNS
from gcl_core.evaluation.encounters import Seen, encounters
from gcl_core.evaluation.reliability import fit_spread, report, verdicts
from gcl_core.evaluation.trials import Trial, load_trials, save_trials
from gcl_core.registrar import Registrar, RegistrarConfig, calibration_file

REPEATED_WEIGHT = 1 / 3  # every fourth world repeats one house; fewer streets do
FIRST_WORLD = 700_000_000  # training takes worlds from its seed x 1,000,000 on


def collect(
    registrar: Registrar, folder: Path, first: int, last: int, limit: float = np.inf
) -> None:
    """Write the trials of each world to a file; those that are there already are kept."""
    import time

    folder.mkdir(parents=True, exist_ok=True)
    others: list[Seen] = []
    began = time.monotonic()
    for number in tqdm(range(first, last), unit='world'):
        path = folder / f'world_{number:05d}.safetensors'
        if path.exists():
            continue
        if time.monotonic() - began > limit:
            break
        trials = list(encounters(registrar, FIRST_WORLD + number, others))
        save_trials(path, trials)
        del others[:-6]


def fit(trials: list[Trial], start: Calibration) -> Calibration:
    """Fit all numbers, from the ranking of hypotheses to the covariance."""
    signs = tuple(SIGNS.values())
    # Repeats look right one by one; it is the lead over the next that tells them apart.
    single = [t for t in trials if t.kind != 'repeated']
    rank = fit_judge(
        torch.cat([t.columns for t in single]),
        torch.cat([t.right for t in single]).float(),
        signs=signs,
        weight=torch.cat([torch.full((len(t.right),), 1 / len(t.right)) for t in single]),
    )
    fine = fit_judge(
        torch.stack([f.columns for t in single for f in t.finalists]),
        torch.cat([t.strict for t in single]).float(),
        signs=signs,
    )
    calibration = replace(start, rank=rank, fine=fine)
    outcome = verdicts(trials, calibration)
    common = torch.tensor([REPEATED_WEIGHT if t.kind == 'repeated' else 1.0 for t in trials])
    trust = fit_judge(outcome.columns, outcome.right.float(), signs=(1, 1, 1), weight=common)
    calibration = replace(calibration, trust=trust)
    return replace(calibration, spread=fit_spread(trials, calibration))


def main() -> None:
    """Collect, fit on two thirds of the worlds, report on the others, fit on all, write."""
    parser = argparse.ArgumentParser(prog='calibrate', description=__doc__)
    parser.add_argument('--weights', default=RegistrarConfig().weights, help='name or file')
    parser.add_argument('--trials', type=Path, required=True, help='folder for trials')
    parser.add_argument('--worlds', type=int, default=150, help='simulated worlds')
    parser.add_argument('--first', type=int, default=0, help='number of the first world')
    parser.add_argument('--seconds', type=float, default=np.inf, help='collect for so long')
    parser.add_argument('--out', type=Path, help='default: beside the weights')
    parser.add_argument('--collect-only', action='store_true', help='fit another time')
    o = parser.parse_args()
    try:
        run(o)
    except GclError as error:
        print(f'calibrate: {error}', file=sys.stderr)
        sys.exit(2)


def run(o: Any) -> None:
    """Run with parsed options."""
    registrar = Registrar(RegistrarConfig(weights=o.weights))
    collect(registrar, o.trials, o.first, o.first + o.worlds, o.seconds)
    if o.collect_only:
        return
    files = sorted(o.trials.glob('world_*.safetensors'))
    worlds = [load_trials(path) for path in files]
    held_out = [t for i, world in enumerate(worlds) if i % 3 == 2 for t in world]
    fitted = [t for i, world in enumerate(worlds) if i % 3 != 2 for t in world]
    if not held_out:
        raise GclError(f'{len(files)} worlds of trials in {o.trials}; at least 3 are needed')
    figures = report(held_out, fit(fitted, registrar.calibration))
    print(figures)
    everything = [t for world in worlds for t in world]
    record = {'worlds': len(worlds), 'trials': len(everything), 'held_out': figures.splitlines()}
    out = o.out or calibration_file(o.weights)
    save_calibration(out, fit(everything, registrar.calibration), record)
    print(f'wrote {out}')


if __name__ == '__main__':
    main()
