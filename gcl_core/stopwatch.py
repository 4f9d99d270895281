"""Where the time of a registration goes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up milliseconds by stage name."""

    def __init__(self) -> None:
        self._began = time.perf_counter()
        self._ms: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a block; a stage may come several times."""
        began = time.perf_counter()
        yield
        self._ms[stage] = self._ms.get(stage, 0.0) + 1e3 * (time.perf_counter() - began)

    def stop(self) -> dict[str, float]:
        """Return the stages and `total`, the time since the watch was made."""
        total = 1e3 * (time.perf_counter() - self._began)
        return {stage: round(ms, 1) for stage, ms in {**self._ms, 'total': total}.items()}
