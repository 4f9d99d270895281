"""What an evaluation on a bag leaves behind: tables, every pair, and trajectories for evo."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.evaluation import metrics
from gcl_core.evaluation.predict import Prediction
from gcl_core.evaluation.score import score
from gcl_core.evaluation.tables import markdown
from gcl_core.files import whole_file, write_text
from gcl_core.to_json import to_json


def write_report(
    out: Path, label: str, predictions: Sequence[Prediction], stamps: Sequence[float], record: Any
) -> str:
    """Write `table.md`, `pairs.csv`, `result.json` and `*.tum` into a folder; return the table.

    Args:
        out: folder.
        label: of the list of pairs.
        predictions: of every method on every pair; `pair.source` counts the pairs.
        stamps: of the pairs, seconds.
        record: of the settings, for `result.json`.
    """
    rows = score(predictions)
    table = f'{label}\n\n{markdown(rows)}'
    write_text(out / 'table.md', table + '\n')
    content = {
        'pairs': label,
        'settings': record,
        'rows': [asdict(row) for row in rows],
        'predictions': [asdict(p) for p in predictions],
    }
    write_text(out / 'result.json', to_json(content) + '\n')
    _write_csv(out / 'pairs.csv', predictions, stamps)
    for method in dict.fromkeys(p.method for p in predictions):
        own = [p for p in predictions if p.method == method]
        name = ''.join(c if c.isalnum() else '_' for c in method.lower())
        write_tum(out / f'{name}.tum', [(stamps[p.pair.source], p.T_estimated) for p in own])
    first = predictions[0].method
    truth = [(stamps[p.pair.source], p.T_true) for p in predictions if p.method == first]
    write_tum(out / 'truth.tum', truth)
    return table


def write_tum(path: Path, poses: Sequence[tuple[float, np.ndarray | None]]) -> None:
    """Write poses of the source in the target's frame, as evo reads them; None is left out.

    A line holds the stamp in seconds, x, y, z in metres, and qx, qy, qz, qw.
    """
    lines = []
    for stamp, T in poses:
        if T is not None:
            values = (*T[:3, 3], *se3.to_quaternion(T[:3, :3]))
            lines.append(f'{stamp:.9f} ' + ' '.join(f'{value:.9f}' for value in values))
    write_text(path, '\n'.join(lines) + '\n' if lines else '')


def _write_csv(path: Path, predictions: Sequence[Prediction], stamps: Sequence[float]) -> None:
    with whole_file(path) as part, part.open('w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(['method', 'stamp', 'distance', 'found', 'rte', 'rre_deg', 'seconds'])
        for p in predictions:
            T, errors = p.T_estimated, ('', '')
            if T is not None:
                errors = (
                    f'{metrics.rte(T, p.T_true):.4f}',
                    f'{metrics.rre_deg(T, p.T_true):.4f}',
                )
            where = [f'{stamps[p.pair.source]:.9f}', f'{p.pair.distance:.3f}']
            writer.writerow([p.method, *where, int(T is not None), *errors, f'{p.seconds:.3f}'])
