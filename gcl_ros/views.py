"""Views of scans: made once each, two at a time, at all headings or at one that is known."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_core.view import View, undescribed
from gcl_ros.deskew import Swept
from gcl_ros.recent import Recent

KEPT = 4  # scans whose views are kept for the next pair
STEPS = 36  # a known heading is rounded to 10 degrees, so that views can be kept; they bear 16


@dataclass(frozen=True)
class Scan:
    """One message, read.

    Attributes:
        cloud: its points, or the centres of its voxels.
        T_view_lidar: turns it to its street.
        swept: what became of the motion while it was seen.
    """

    cloud: PointCloud
    T_view_lidar: Float[np.ndarray, '4 4']
    swept: Swept = field(default_factory=Swept)


@dataclass(frozen=True)
class Look:
    """How a scan is to be described.

    Attributes:
        turns: evenly spaced headings.
        step: where the first of them is, in `STEPS` of a full turn.
    """

    turns: int = 1
    step: int = 0

    @property
    def yaw(self) -> float:
        """The first turn, radians."""
        return 2 * np.pi * self.step / STEPS


def look_at(yaw: float) -> Look:
    """The one heading that is nearest to a turn, radians."""
    return Look(1, round(yaw / (2 * np.pi) * STEPS) % STEPS)


class Views:
    """Makes views and keeps the last few; a target's serves all its sources.

    Args:
        registrar: describes.
    """

    def __init__(self, registrar: Registrar) -> None:
        self._registrar = registrar
        self._kept: Recent[dict[Look, View]] = Recent(KEPT)
        self._helper = ThreadPoolExecutor(1, thread_name_prefix='views')

    def both(self, source: Scan, look: Look, target: Scan) -> tuple[View, View]:
        """The views of a pair, source and target as it is, each made by a thread of its own.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        other = self._helper.submit(self.get, target, Look())
        try:
            view = self.get(source, look)
        finally:
            other.exception()  # whatever happened here, the helper is free again
        return view, other.result()

    def get(self, scan: Scan, look: Look) -> View:
        """Describe a scan, or take what is known of it.

        Raises:
            GclError: it has no point within the network's range.
        """
        config = self._registrar.config
        views = self._kept.get((scan, config), dict[Look, View])
        if look not in views:
            last = next(reversed(views.values()), None)
            known = last or undescribed(scan.cloud, scan.T_view_lidar, config.refine)
            views[look] = self._registrar.view(
                scan.cloud, turns=look.turns, yaw=look.yaw, known=known
            )
        return views[look]

    def close(self) -> None:
        """End the helping thread."""
        self._helper.shutdown(wait=False, cancel_futures=True)
