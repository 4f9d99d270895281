"""Clouds as they come, raw or compact, to a registration.

Scans are turned to their streets, but a street runs both ways and may be crossed, so that the
source is described at several headings. Whoever receives describes: both come as points.

Where the heading is known from the last transform, one description of the source is enough; more
are looked at while nothing is accepted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.evaluation.agreement import agreeing
from gcl_core.registrar import Registrar
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Correspondences, PointCloud, Registration
from gcl_core.view import View
from gcl_ros.compact_cloud import compact_cloud, is_compact
from gcl_ros.conversions import name_of, point_cloud
from gcl_ros.deskew import Swept
from gcl_ros.recent import Recent
from gcl_ros.views import Look, Scan, Views, look_at

KEPT = 4  # scans that are kept for the next pair
FEWEST_POINTS = 1000  # anything fits a handful of points


@dataclass(frozen=True)
class Registered:
    """A registration and what it was made from.

    Attributes:
        result: of source against target.
        source: view that was taken.
        target: view that was taken.
        headings: at how many the source was looked at.
    """

    result: Registration
    source: View
    target: View
    headings: int


class Exchange:
    """Registers two messages, each a raw cloud or a compact scan.

    Args:
        registrar: does the work.
    """

    def __init__(self, registrar: Registrar) -> None:
        self.registrar = registrar
        self._scans: Recent[Scan] = Recent(KEPT)
        self._views = Views(registrar)
        self._target_yaw = 0.0  # of the last target's view: about that of the next

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

    def raw(self, cloud: PointCloud) -> Scan:
        """A scan of which there are the points."""
        return Scan(cloud, self.registrar.model.facing(cloud))

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
        return replace(self.raw(cloud), swept=swept)

    def register(self, *, source: Scan, target: Scan, yaw: float | None = None) -> Registered:
        """Find the transform that maps source points into the target frame.

        Args:
            source: to be mapped.
            target: to be mapped into.
            yaw: heading that the transform should have, radians, where one is known. It only
                says where to look first: what is found there is judged like anything else.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        watch = Stopwatch()
        self._target_yaw = se3.yaw(target.T_view_lidar)
        headings = 0
        for look in self._looks(source, yaw):
            registered = self._at(look, source, target, watch)
            headings += registered.headings
            if registered.result.accepted:
                break
        return replace(registered, headings=headings)

    def prepare_source(self, scan: Scan, *, yaw: float | None) -> None:
        """Describe a source whose target is about to come; `yaw` as for `register`."""
        self._views.get(scan, self._looks(scan, yaw)[0])

    def prepare_target(self, scan: Scan) -> None:
        """Describe a target whose source is about to come."""
        self._target_yaw = se3.yaw(scan.T_view_lidar)
        self._views.get(scan, Look())

    def close(self) -> None:
        """End the thread that helps."""
        self._views.close()

    def _looks(self, source: Scan, yaw: float | None) -> list[Look]:
        """At which headings the source is described, one look after the other."""
        config = self.registrar.config
        if config.turns == 1:
            yaw = 0.0
        known = []
        if yaw is not None:
            known = [look_at(yaw + self._target_yaw - se3.yaw(source.T_view_lidar))]
        if config.turns == 1:
            return known
        return list(dict.fromkeys([*known, *(Look(turns) for turns in config.looks)]))

    def _at(self, look: Look, source: Scan, target: Scan, watch: Stopwatch) -> Registered:
        with watch('describe'):
            views = self._views.both(source, look, target)
        result = self.registrar.register_views(source=views[0], target=views[1], watch=watch)
        return Registered(result, *views, look.turns)

    def agreeing(self, registered: Registered) -> Correspondences:
        """Matches that agree with the transform within a metre, in the scans' own frames."""
        T = registered.result.T_target_source
        if T is None:
            raise GclError('no transform to agree with')
        return agreeing(
            T,
            source=registered.source,
            target=registered.target,
            config=self.registrar.config.match,
        )
