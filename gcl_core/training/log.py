"""What a run writes while it runs: one JSON object a line, and TensorBoard's event files."""

from __future__ import annotations

import json
from pathlib import Path
from types import TracebackType
from typing import Any


class TrainingLog:
    """Appends rows to `log.jsonl`, and scalars for TensorBoard where it is installed."""

    def __init__(self, folder: Path) -> None:
        self._file = (folder / 'log.jsonl').open('a')
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
