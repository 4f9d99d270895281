"""What a run writes while it runs: one JSON object a line, and TensorBoard's event files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from gcl_core.files import write_text


class TrainingLog:
    """Appends rows to `log.jsonl`, and scalars for TensorBoard where it is installed.

    Args:
        folder: of the run.
        step: that the run goes on from; rows of later steps are of a run that was stopped before
            its next checkpoint, and go.
    """

    def __init__(self, folder: Path, step: int) -> None:
        path = folder / 'log.jsonl'
        if path.is_file():
            write_text(path, ''.join(f'{line}\n' for line in _until(path, step)))
        self._file = path.open('a')
        self._board: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:  # optional: pip install tensorboard
            return
        self._board = SummaryWriter(str(folder / 'tensorboard'))

    def __enter__(self) -> TrainingLog:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
        if self._board:
            self._board.close()

    def write(self, row: dict[str, float]) -> None:
        """Write the figures of a step; `row['step']` is its number."""
        self._file.write(json.dumps(row) + '\n')
        self._file.flush()
        if self._board:
            for name, value in row.items():
                self._board.add_scalar(name, value, int(row['step']))


def _until(path: Path, step: int) -> Iterator[str]:
    """Lines of a log up to a step; one that a kill cut off is none."""
    for line in path.read_text().splitlines():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if row['step'] <= step:
            yield line
