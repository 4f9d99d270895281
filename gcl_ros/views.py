"""Views of scans: made once each, two at a time."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcl_core.ops.threads import SideBySide
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud
from gcl_core.view import View
from gcl_ros.deskew import Swept
from gcl_ros.recent import Recent

KEPT = 4  # scans whose views are kept for the next pair


@dataclass(frozen=True)
class Scan:
    """One message, read.

    Attributes:
        cloud: its points, or the centres of its voxels.
        swept: what became of the motion while it was seen.
    """

    cloud: PointCloud
    swept: Swept = field(default_factory=Swept)


class Views:
    """Makes views and keeps the last few; a target's serves all its sources.

    Args:
        registrar: describes.
    """

    def __init__(self, registrar: Registrar) -> None:
        self._registrar = registrar
        self._kept: Recent[View] = Recent(KEPT)
        self._side_by_side = SideBySide()

    def both(self, source: Scan, target: Scan) -> tuple[View, View]:
        """The views of a pair, each made by a thread of its own.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        return self._side_by_side(lambda: self.get(source), lambda: self.get(target))

    def get(self, scan: Scan) -> View:
        """Describe a scan, or take what is known of it.

        Raises:
            GclError: it has no point within the network's range.
        """
        config = self._registrar.config
        return self._kept.get((scan, config), lambda: self._registrar.view(scan.cloud))

    def close(self) -> None:
        """End the helping thread."""
        self._side_by_side.close()
