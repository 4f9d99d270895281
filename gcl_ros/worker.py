"""One thread that works on what it takes until it is stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from gcl_core.errors import GclError

T = TypeVar('T')
PATIENCE = 30.0  # seconds that stopping waits for the work at hand


class Worker(Generic[T]):
    """Takes one thing after the other and outlives whatever goes wrong with any of them.

    Args:
        take: waits for the next thing; None ends the thread.
        work: done with each; the second argument says whether its outcome is still wanted.
        failed: told why one was left out.
        close: makes `take` return None.
    """

    def __init__(
        self,
        take: Callable[[], T | None],
        work: Callable[[T, Callable[[], bool]], None],
        failed: Callable[[T, str], None],
        close: Callable[[], None],
    ) -> None:
        self._take, self._work, self._failed, self._close = take, work, failed, close
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name='worker', daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while (thing := self._take()) is not None:
            try:
                self._work(thing, self._wanted)
            except Exception as error:
                reason = str(error) if isinstance(error, GclError) else f'please report: {error!r}'
                if self._wanted():  # a context that is shut down is no fault of the thing
                    self._failed(thing, reason)

    def _wanted(self) -> bool:
        """Whether anybody still waits for what this worker, and none after it, does."""
        return not self._stopping

    def stop(self) -> None:
        """Finish the work at hand and end; its result is not wanted any more."""
        self._stopping = True
        self._close()
        self._thread.join(timeout=PATIENCE)
