"""Views of scans: made once each, two at a time, at all headings or at one that is known."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_core.view import View, undescribed
from gcl_ros.deskew import Swept
from gcl_ros.feature_cloud import Described
from gcl_ros.recent import Recent

KEPT = 4  # scans whose views are kept for the next pair
STEPS = 36  # a known heading is rounded to 10 degrees, so that views can be kept; they bear 16


@dataclass(frozen=True)
class Scan:
    """One message, read.

    Attributes:
        cloud: its points, or its key points.
        T_view_lidar: turns it to its street.
        described: features if it came described.
        swept: what became of the motion while it was seen.
    """

    cloud: PointCloud
    T_view_lidar: Float[np.ndarray, '4 4']
    described: Described | None = None
    swept: Swept = field(default_factory=Swept)

    @property
    def headings(self) -> int:
        """How many it came described at; 0 if raw."""
        return len(self.described.headings) if self.described else 0


def scan_of(described: Described) -> Scan:
    """A scan that came described: the key points of its first heading stand in for its points."""
    T_view_lidar = se3.from_xyz_rpy(yaw=described.yaws[0])
    points = se3.transform(se3.inverse(T_view_lidar), described.headings[0].points.numpy())
    return Scan(PointCloud(points), T_view_lidar, described)


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

    def both(self, still: Scan, turned: Scan, look: Look) -> tuple[View, View]:
        """The views of a pair, each made by a thread of its own: the still one as it is.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        other = self._helper.submit(self.get, still, Look())
        try:
            view = self.get(turned, look)
        finally:
            other.exception()  # whatever happened here, the helper is free again
        return other.result(), view

    def get(self, scan: Scan, look: Look) -> View:
        """Describe a scan, or take what is known of it.

        Raises:
            GclError: it has no point within the network's range.
        """
        config = self._registrar.config
        views = self._kept.get((scan, config), dict[Look, View])
        if look not in views:
            last = next(reversed(views.values()), None)
            described = scan.described is not None
            known = last or undescribed(
                scan.cloud, scan.T_view_lidar, config.refine, keypoints=described
            )
            views[look] = self._make(scan, look, known)
        return views[look]

    def _make(self, scan: Scan, look: Look, known: View) -> View:
        if scan.described is None:
            return self._registrar.view(scan.cloud, turns=look.turns, yaw=look.yaw, known=known)
        own = se3.yaw(scan.T_view_lidar)
        offered = np.array(scan.described.yaws) - own
        wanted = look.yaw + 2 * np.pi * np.arange(look.turns) / look.turns
        off = np.abs(np.angle(np.exp(1j * (wanted[:, None] - offered))))
        rows = list(dict.fromkeys(off.argmin(1).tolist()))
        return replace(
            known,
            headings=[scan.described.headings[row] for row in rows],
            turns=torch.from_numpy(np.stack([se3.from_xyz_rpy(yaw=offered[r]) for r in rows])),
        )

    def close(self) -> None:
        """End the helping thread."""
        self._helper.shutdown(wait=False, cancel_futures=True)
