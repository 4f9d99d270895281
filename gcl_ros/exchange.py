"""Clouds as they come, raw or described, to a registration: who turns whom, and back.

The weights bear headings within about 40 degrees, so that one of the two scans is described at
several. Whoever has the points can turn them: the source if it is raw, else the target. Where
both come described, the side with more headings turns; with one heading each, only vehicles that
face the same way are found.

Key points of a described scan stand in for its points in the checks and in GICP.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.refine import prepare
from gcl_core.estimation.surface import surface
from gcl_core.evaluation.agreement import agreeing
from gcl_core.registrar import Registrar, RegistrarConfig, Stopwatch, View
from gcl_core.types import Correspondences, Features, PointCloud, Registration
from gcl_ros.conversions import point_cloud
from gcl_ros.feature_cloud import feature_cloud, is_feature_cloud, turns_of, weights_hash
from gcl_ros.recent import Recent

KEPT = 4  # scans and views that are kept for the next pair
FEWEST_POINTS, FEWEST_KEY_POINTS = 1000, 100  # anything fits a handful of points


@dataclass(frozen=True)
class Scan:
    """One message, read.

    Attributes:
        cloud: its points, or its key points.
        headings: features if it came described; empty if raw.
    """

    cloud: PointCloud
    headings: tuple[Features, ...] = ()


@dataclass(frozen=True)
class Registered:
    """A registration and what it was made from.

    Attributes:
        result: of source against target.
        source: view that was taken.
        target: view that was taken.
        swapped: whether the target was turned; `source` is then the target's view.
    """

    result: Registration
    source: View
    target: View
    swapped: bool


class Exchange:
    """Registers two messages, each a raw cloud or features.

    Args:
        registrar: does the work; its weights must have described the features.
    """

    def __init__(self, registrar: Registrar) -> None:
        self.registrar = registrar
        self._scans: Recent[Scan] = Recent(KEPT)
        self._views: Recent[View] = Recent(KEPT)
        self.weights = weights_hash(registrar.model)

    def read(
        self, message: Any, *, deskew: Callable[[Any], PointCloud | None] = lambda _: None
    ) -> Scan:
        """Read a message; its fields tell whether it is raw.

        Args:
            message: sensor_msgs/PointCloud2.
            deskew: undoes the motion during a raw scan, or gives None.

        Raises:
            GclError: malformed, of other weights, or too few points.
        """
        return self._scans.get((message,), lambda: self._scan(message, deskew))

    def _scan(self, message: Any, deskew: Callable[[Any], PointCloud | None]) -> Scan:
        if is_feature_cloud(message):
            length = self.registrar.model.config.descriptor
            headings = tuple(feature_cloud(message, self.weights, length))
            scan = Scan(PointCloud(headings[0].points.numpy()), headings)
        else:
            scan = Scan(deskew(message) or point_cloud(message))
        fewest = FEWEST_KEY_POINTS if scan.headings else FEWEST_POINTS
        if len(scan.cloud) < fewest:
            raise GclError(
                f'cloud in frame {message.header.frame_id!r} has {len(scan.cloud)} '
                f'{"key " if scan.headings else ""}points, {fewest} are needed'
            )
        return scan

    def register(self, *, source: Scan, target: Scan) -> Registered:
        """Find the transform that maps source points into the target frame.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        watch = Stopwatch()
        turned_target = bool(source.headings) and (
            not target.headings or len(target.headings) > len(source.headings)
        )
        turned, still = (target, source) if turned_target else (source, target)
        with watch('describe'):
            views = (self._view(still, turns=1), self._view(turned))
        result = self.registrar.register_views(target=views[0], source=views[1], watch=watch)
        if turned_target:
            result = inverted(result)
        return Registered(result, views[1], views[0], turned_target)

    def _view(self, scan: Scan, *, turns: int | None = None) -> View:
        """Describe a scan, or take what is known of it: a target serves all its sources."""
        config = self.registrar.config
        turns = turns or (len(scan.headings) or config.turns)
        key = (scan, turns, config)
        return self._views.get(key, lambda: self._make_view(scan, turns, config))

    def _make_view(self, scan: Scan, turns: int, config: RegistrarConfig) -> View:
        if not scan.headings:
            return self.registrar.view(scan.cloud, turns=turns)
        headings = list(scan.headings)[:turns]
        matrices = turns_of(len(scan.headings))[:turns]
        return View(
            headings=headings,
            turns=torch.from_numpy(np.stack(matrices)),
            surface=surface(scan.cloud),
            prepared=prepare(scan.cloud, config.refine),
        )

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
