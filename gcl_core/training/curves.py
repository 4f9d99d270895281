"""`python -m gcl_core.training.curves RUN…`: the curves of one or several training runs."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gcl_core.errors import GclError, bad_input_exits
from gcl_core.evaluation.plots import save

WINDOW = 25  # steps that a curve is averaged over


def training_curves(path: Path, logs: Mapping[str, Path]) -> None:
    """Draw contrastive loss and share of nearest features that are right over steps.

    Args:
        path: picture to write.
        logs: `log.jsonl` of each run, by name.

    Raises:
        GclError: a log is missing or empty, or the picture cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4))
    axes = figure.subplots(1, 2)
    for name, log in logs.items():
        rows = _rows(log)
        window = min(WINDOW, len(rows))
        steps = [row['step'] for row in rows][window - 1 :]
        for ax, key in zip(axes, ('contrast', 'top1'), strict=True):
            values = np.array([row.get(key, np.nan) for row in rows])
            smooth = np.convolve(values, np.ones(window) / window, mode='valid')
            ax.plot(steps, smooth, label=name)
    for ax, title in zip(axes, ('contrastive loss', 'nearest feature right, share'), strict=True):
        ax.set(xlabel='step', title=title)
        ax.grid(alpha=0.3)
    if len(logs) > 1:
        axes[0].legend()
    save(figure, path)


def _rows(log: Path) -> list[dict[str, float]]:
    try:
        rows = [json.loads(line) for line in log.read_text().splitlines()]
    except (OSError, ValueError) as error:
        raise GclError(f'cannot read the training log {log}: {error}') from None
    if not rows:
        raise GclError(f'{log} is empty; train first')
    return rows


def main() -> None:
    """Draw the runs named on the command line."""
    parser = argparse.ArgumentParser(prog='curves', description=__doc__)
    parser.add_argument('runs', type=Path, nargs='+', help='folders that `gcl train` wrote')
    parser.add_argument('--out', type=Path, required=True, help='picture')
    options = parser.parse_args()
    with bad_input_exits('curves'):
        training_curves(options.out, {run.name: run / 'log.jsonl' for run in options.runs})


if __name__ == '__main__':
    main()
