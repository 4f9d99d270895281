"""Clouds as they come, raw or compact, to a registration.

Whoever receives describes: both come as points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gcl_core.errors import GclError
from gcl_core.evaluation.agreement import agreeing
from gcl_core.registrar import Registrar
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Correspondences, Registration
from gcl_core.view import View
from gcl_ros.compact_cloud import compact_cloud, is_compact
from gcl_ros.conversions import name_of, point_cloud
from gcl_ros.deskew import Swept
from gcl_ros.recent import Recent
from gcl_ros.views import Scan, Views

KEPT = 4  # scans that are kept for the next pair
FEWEST_POINTS = 1000  # anything fits a handful of points


@dataclass(frozen=True)
class Registered:
    """A registration and what it was made from.

    Attributes:
        result: of source against target.
        source: view that was taken.
        target: view that was taken.
    """

    result: Registration
    source: View
    target: View


class Exchange:
    """Registers two messages, each a raw cloud or a compact scan.

    Args:
        registrar: does the work.
    """

    def __init__(self, registrar: Registrar) -> None:
        self.registrar = registrar
        self._scans: Recent[Scan] = Recent(KEPT)
        self._views = Views(registrar)

    def read(self, message: Any, *, deskew: Callable[[Any], Swept] = lambda _: Swept()) -> Scan:
        """Read a message; its fields tell whether it is raw.

        Args:
            message: sensor_msgs/PointCloud2.
            deskew: undoes the motion during a raw scan, or says what is left of it; a compact one
                was left to its sender.

        Raises:
            GclError: malformed, of another version, or too few points.
        """
        return self._scans.get((message,), lambda: self._scan(message, deskew))

    def _scan(self, message: Any, deskew: Callable[[Any], Swept]) -> Scan:
        if is_compact(message):
            swept, cloud = Swept(by_sender=True), compact_cloud(message)
        else:
            swept = deskew(message)
            cloud = swept.cloud or point_cloud(message)
        if len(cloud) < FEWEST_POINTS:
            raise GclError(
                f'{name_of(message)} has {len(cloud)} points, {FEWEST_POINTS} are needed'
            )
        return Scan(cloud, swept)

    def register(self, *, source: Scan, target: Scan) -> Registered:
        """Find the transform that maps source points into the target frame.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        watch = Stopwatch()
        with watch('describe'):
            view, seen = self._views.both(source, target)
        result = self.registrar.register_views(source=view, target=seen, watch=watch)
        return Registered(result, view, seen)

    def prepare(self, scan: Scan) -> None:
        """Describe a scan whose partner is about to come."""
        self._views.get(scan)

    def close(self) -> None:
        """End the thread that helps."""
        self._views.close()

    def agreeing(self, registered: Registered) -> Correspondences:
        """Matches that agree with the transform within a metre, in the scans' own frames."""
        T = registered.result.T_target_source
        if T is None:
            raise GclError('no transform to agree with')
        return agreeing(self.registrar, T, source=registered.source, target=registered.target)
