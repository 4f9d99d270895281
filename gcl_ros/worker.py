"""One thread that works on the newest pair until it is stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from gcl_core.errors import GclError
from gcl_ros.pairing import Pairing

M = TypeVar('M')
PATIENCE = 30.0  # seconds that stopping waits for the pair at hand


class Worker(Generic[M]):
    """Takes pairs and outlives whatever goes wrong with any of them.

    Args:
        pairing: gives the pairs; it is closed when the worker stops.
        work: done with each pair, source first.
        failed: told why a pair was left out.
    """

    def __init__(
        self,
        pairing: Pairing[M],
        work: Callable[[M, M], None],
        failed: Callable[[str], None],
    ) -> None:
        self._pairing, self._work, self._failed = pairing, work, failed
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name='worker', daemon=True)
        self._thread.start()

    @property
    def stopping(self) -> bool:
        """Whether results are not wanted any more."""
        return self._stopping

    def _run(self) -> None:
        while (pair := self._pairing.take()) is not None:
            try:
                self._work(*pair)
            except GclError as error:
                self._failed(str(error))
            except Exception as error:
                if not self._stopping:  # a context that is shut down is no fault of the pair
                    self._failed(f'please report: {error!r}')

    def stop(self) -> None:
        """Finish the pair at hand and end."""
        self._stopping = True
        self._pairing.close()
        self._thread.join(timeout=PATIENCE)
