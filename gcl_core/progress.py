"""Progress of what takes longer than a moment, for a person who watches."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tqdm import tqdm


def progress(items: Iterable[Any] | None = None, *, hidden: bool = False, **options: Any) -> Any:
    """A bar on stderr after 2 s, only where that is a terminal.

    Args:
        items: to go through; without them call `update()` of what is returned.
        hidden: never show it, in all but one of several processes.
        options: of tqdm.
    """
    return tqdm(items, disable=hidden or None, delay=2.0, **options)
