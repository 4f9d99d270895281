"""Predictions as lines of JSON: written as they are made, read when a run goes on."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core.data.pairs import Pair
from gcl_core.errors import GclError
from gcl_core.evaluation.predict import Prediction

UNKNOWN = ('seconds', 'peak_mb', 'overlap')  # nan in memory, null in JSON, which has no nan


def to_line(prediction: Prediction) -> str:
    """One line of JSON, without its end."""
    values: dict[str, Any] = asdict(prediction)
    for key in UNKNOWN:
        values[key] = values[key] if np.isfinite(values[key]) else None
    return json.dumps(values, default=lambda array: array.tolist())


def from_line(line: str) -> Prediction:
    """Read what `to_line` wrote."""
    values = json.loads(line)
    pair = values['pair']
    values['pair'] = Pair(**{**pair, 'bin': tuple(pair['bin'])})
    for key in ('T_true', 'T_estimated'):
        values[key] = None if values[key] is None else np.array(values[key])
    for key in UNKNOWN:
        values[key] = np.nan if values[key] is None else values[key]
    return Prediction(**values)


def read_lines(folder: Path) -> list[str]:
    """Lines of every process's file in a folder; one that was cut off by a kill is left out.

    Raises:
        GclError: a file is not what this version writes.
    """
    found = []
    for path in sorted(folder.glob('predictions-*.jsonl')):
        for number, line in enumerate(_whole(path), 1):
            try:
                from_line(line)
            except (ValueError, TypeError, KeyError) as error:
                raise GclError(
                    f'{path}, line {number} is no prediction ({error}); remove the folder to '
                    'start afresh'
                ) from None
            found.append(line)
    return found


def mend(path: Path) -> None:
    """Cut off a last line that a kill left without its end."""
    if path.is_file():
        whole = ''.join(f'{line}\n' for line in _whole(path))
        if len(whole.encode()) != path.stat().st_size:
            path.write_text(whole)


def _whole(path: Path) -> list[str]:
    return path.read_text().split('\n')[:-1]


def merged(lines: Iterable[str], methods: Iterable[str]) -> list[Prediction]:
    """Predictions in order of pairs, then of methods; each once."""
    place = {name: i for i, name in enumerate(methods)}
    found: dict[tuple[int, int], Prediction] = {}
    for prediction in map(from_line, lines):
        found.setdefault((prediction.task, place[prediction.method]), prediction)
    return [found[key] for key in sorted(found)]
