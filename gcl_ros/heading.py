"""The heading between two vehicles: what it last was is where it is looked for next."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from gcl_core import se3


class Heading:
    """Remembers the heading of the last accepted transform for a while.

    Args:
        memory: seconds, in stamps; 0 remembers nothing.
    """

    def __init__(self, memory: float) -> None:
        self.memory = memory
        self._last: tuple[float, float] | None = None

    def found(self, stamp: float, T_target_source: Float[np.ndarray, '4 4']) -> None:
        """Take an accepted transform."""
        self._last = stamp, se3.yaw(T_target_source)

    def forget(self) -> None:
        """Start anew."""
        self._last = None

    def at(self, stamp: float) -> float | None:
        """Heading that the transform is likely to have, radians; None if that is not known."""
        last = self._last
        if last is None or self.memory == 0 or abs(stamp - last[0]) > self.memory:
            return None
        return last[1]
