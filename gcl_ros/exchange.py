"""Clouds as they come, raw or described, to a registration: who turns whom, and back.

Scans are turned to their streets, but a street runs both ways and may be crossed, so that one of
the two is described at several headings. Whoever has the points can turn them: the source if it
is raw, else the target. Where both come described, the side with more headings turns.

Where the heading is known from the last transform, one description of the turned scan is enough;
more are looked at while nothing is accepted.

Key points of a described scan stand in for its points in the checks and in GICP.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.evaluation.agreement import agreeing
from gcl_core.registrar import FEWEST_KEY_POINTS, Registrar
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Correspondences, PointCloud, Registration
from gcl_core.view import View
from gcl_ros.conversions import name_of, point_cloud
from gcl_ros.deskew import Swept
from gcl_ros.feature_cloud import feature_cloud, is_feature_cloud, weights_hash
from gcl_ros.recent import Recent
from gcl_ros.views import Look, Scan, Views, look_at, scan_of

KEPT = 4  # scans that are kept for the next pair
FEWEST_POINTS = 1000  # anything fits a handful of points


@dataclass(frozen=True)
class Registered:
    """A registration and what it was made from.

    Attributes:
        result: of source against target.
        source: view that was taken.
        target: view that was taken.
        swapped: whether the target was turned; `source` is then the target's view.
        headings: at how many the turned one was looked at.
    """

    result: Registration
    source: View
    target: View
    swapped: bool
    headings: int


class Exchange:
    """Registers two messages, each a raw cloud or features.

    Args:
        registrar: does the work; its weights must have described the features.
    """

    def __init__(self, registrar: Registrar) -> None:
        self.registrar = registrar
        self._scans: Recent[Scan] = Recent(KEPT)
        self._views = Views(registrar)
        self._still_yaw = 0.0  # of the last still scan's view: about that of the next
        self.weights = weights_hash(registrar.model)

    def read(self, message: Any, *, deskew: Callable[[Any], Swept] = lambda _: Swept()) -> Scan:
        """Read a message; its fields tell whether it is raw.

        Args:
            message: sensor_msgs/PointCloud2.
            deskew: undoes the motion during a raw scan, or says what is left of it.

        Raises:
            GclError: malformed, of other weights, or too few points.
        """
        return self._scans.get((message,), lambda: self._scan(message, deskew))

    def raw(self, cloud: PointCloud) -> Scan:
        """A scan of which there are the points."""
        return Scan(cloud, self.registrar.model.facing(cloud))

    def _scan(self, message: Any, deskew: Callable[[Any], Swept]) -> Scan:
        swept = deskew(message)
        if is_feature_cloud(message):
            length = self.registrar.model.config.descriptor
            scan = scan_of(feature_cloud(message, self.weights, length))
        else:
            scan = self.raw(swept.cloud or point_cloud(message))
        fewest = FEWEST_KEY_POINTS if scan.headings else FEWEST_POINTS
        if len(scan.cloud) < fewest:
            raise GclError(
                f'{name_of(message)} has {len(scan.cloud)} '
                f'{"key " if scan.headings else ""}points, {fewest} are needed'
            )
        return replace(scan, swept=swept)

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
        swapped = turns_target(source=source, target=target)
        still, turned = (source, target) if swapped else (target, source)
        self._still_yaw = se3.yaw(still.T_view_lidar)
        headings = 0
        for look in self._looks(turned, swapped, yaw):
            registered = self._at(look, still, turned, swapped, watch)
            headings += registered.headings
            if registered.result.accepted:
                break
        return replace(registered, headings=headings)

    def prepare(self, scan: Scan, *, turned: bool, swapped: bool, yaw: float | None) -> None:
        """Describe a scan whose partner is about to come.

        Args:
            scan: of either side.
            turned: whether it is the one that will be turned.
            swapped: whether that is the target.
            yaw: as for `register`.
        """
        if not turned:
            self._still_yaw = se3.yaw(scan.T_view_lidar)
        self._views.get(scan, self._looks(scan, swapped, yaw)[0] if turned else Look())

    def close(self) -> None:
        """End the thread that helps."""
        self._views.close()

    def _looks(self, turned: Scan, swapped: bool, yaw: float | None) -> list[Look]:
        """At which headings the turned scan is described, one look after the other."""
        config = self.registrar.config
        if config.turns == 1:
            yaw = 0.0
        known = []
        if yaw is not None:
            between = (-yaw if swapped else yaw) + self._still_yaw - se3.yaw(turned.T_view_lidar)
            known = [look_at(between)]
        if config.turns == 1:
            return known
        if turned.headings == 1:
            return [Look()]
        every = [turned.headings] if turned.headings else config.looks
        return list(dict.fromkeys([*known, *(Look(turns) for turns in every)]))

    def _at(
        self, look: Look, still: Scan, turned: Scan, swapped: bool, watch: Stopwatch
    ) -> Registered:
        with watch('describe'):
            views = self._views.both(still, turned, look)
        result = self.registrar.register_views(target=views[0], source=views[1], watch=watch)
        if swapped:
            result = inverted(result)
        return Registered(result, views[1], views[0], swapped, look.turns)

    def agreeing(self, registered: Registered) -> Correspondences:
        """Matches that agree with the transform within a metre, in the scans' own frames."""
        T = registered.result.T_target_source
        if T is None:
            raise GclError('no transform to agree with')
        found = agreeing(
            se3.inverse(T) if registered.swapped else T,
            source=registered.source,
            target=registered.target,
            config=self.registrar.config.match,
        )
        if not registered.swapped:
            return found
        return Correspondences(found.target, found.source, found.weight)


def turns_target(*, source: Scan, target: Scan) -> bool:
    """Whether it is the target that is turned: the source came described, with fewer headings."""
    if source.headings == 0:
        return False
    return not target.headings or target.headings > source.headings


def inverted(result: Registration) -> Registration:
    """The registration of the target against the source."""
    T, covariance = result.T_target_source, result.covariance
    if T is None:
        return result
    if covariance is not None:
        covariance = inverted_covariance(T, covariance)
    return replace(result, T_target_source=se3.inverse(T), covariance=covariance)


def inverted_covariance(
    T: Float[np.ndarray, '4 4'], covariance: Float[np.ndarray, '6 6']
) -> Float[np.ndarray, '6 6']:
    """Covariance of the inverse of T.

    With t' = t + dt and R' = exp(dr) R, the inverse moves by -R^T (dt + t x dr) and -R^T dr.
    """
    x, y, z = T[:3, 3]
    back = -T[:3, :3].T
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    jacobian = np.block([[back, back @ cross], [np.zeros((3, 3)), back]])
    return jacobian @ covariance @ jacobian.T
