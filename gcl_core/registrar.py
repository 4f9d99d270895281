"""A pair of scans to a registration: describe, match, estimate, verify, refine, judge."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.confidence import MadeWith, load_calibration
from gcl_core.estimation.decision import (
    Finalist,
    VerifyConfig,
    examine,
    nothing_fits,
    refine_finalists,
    summary,
)
from gcl_core.estimation.estimators import EstimatorConfig
from gcl_core.estimation.evidence import Scene
from gcl_core.estimation.hypothesis import Hypothesis, ranked
from gcl_core.estimation.likeness import keypoint_grid, raised
from gcl_core.estimation.refine import RefineConfig, prepare
from gcl_core.estimation.search import Search
from gcl_core.estimation.surface import surface
from gcl_core.files import sha256
from gcl_core.matching.match import MatchConfig
from gcl_core.matching.vote import likeliest_first
from gcl_core.models import zoo
from gcl_core.ops.native.instructions import held
from gcl_core.ops.native.kernels import kernels_for
from gcl_core.ops.threads import SideBySide
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Features, Heading, PointCloud, Registration
from gcl_core.view import View

FEWEST_KEY_POINTS = 100  # anything fits a handful of points
HEADINGS = (1, 4, 12)
STEP = math.pi / 6  # between neighbouring headings of 12
ALONG = math.radians(3.0)  # two scans whose streets differ by less need no other description
TURN_MARGIN = 0.6  # of what weights bear: beyond it, headings are another turn's business


@dataclass(frozen=True)
class RegistrarConfig:
    """What happens between two scans and a transform.

    Attributes:
        weights: `gcl_conv`, `gcl_kpconv` (more right matches, slower), or a file.
        device: where the network computes: `auto` takes a GPU if torch finds one.
        precision: of the network and of the search in feature space: `bfloat16`, `float32`, or
            `auto`: bfloat16 where one instruction multiplies it.
        headings: of the source that are searched: 12 find any; 4, quarter turns, are enough where
            both scans agree on the direction of the street; 1 is for vehicles that face the same
            way. The likeliest comes first, others only while nothing is accepted.
        max_distance: between the sensors, metres; what would be farther is left out. Of two scans
            that reach 80 m, little is left in common, and that sparse.
        min_probability: of being right (within 0.6 m and 1.5 degrees) for a transform to be
            accepted.
        match: features to correspondences.
        estimator: search for hypotheses.
        verify: dense checks of hypotheses.
        refine: GICP afterwards.
    """

    weights: str = zoo.DEFAULT
    device: Literal['auto', 'cpu', 'cuda'] = 'auto'
    precision: Literal['auto', 'bfloat16', 'float32'] = 'auto'
    headings: int = 12
    max_distance: float = 80.0
    min_probability: float = 0.9
    match: MatchConfig = field(default_factory=MatchConfig)
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    verify: VerifyConfig = field(default_factory=VerifyConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)

    def __post_init__(self) -> None:
        if self.headings not in HEADINGS:
            raise GclError(f'headings is {self.headings}; it must be one of {HEADINGS}')
        zoo.dtype_named(self.precision)
        if not self.max_distance > 0:
            raise GclError(f'max_distance is {self.max_distance}; it must be positive, metres')
        if not 0 <= self.min_probability <= 1:
            raise GclError(f'min_probability is {self.min_probability}; it must lie in [0, 1]')


def settings_hash(config: RegistrarConfig) -> str:
    """Tells apart what a calibration depends on, from matches to refined transforms."""
    estimator = {'name': config.estimator.name} | asdict(
        getattr(config.estimator, config.estimator.name)
    )
    refinement = asdict(config.refine)
    for settings, indifferent in ((estimator, 'seed'), (refinement, 'threads')):
        settings.pop(indifferent, None)
    held = [asdict(config.match), estimator, asdict(config.verify), refinement]
    return hashlib.sha256(json.dumps(held, sort_keys=True).encode()).hexdigest()


class Registrar:
    """Registers pairs of scans; holds the network and nothing about any scan."""

    def __init__(self, config: RegistrarConfig | None = None) -> None:
        self.config = config or RegistrarConfig()
        self.device = zoo.device_named(self.config.device)
        self.model = zoo.load_weights(self.config.weights).to(self.device)
        self.model.dtype = zoo.dtype_named(self.config.precision)
        self.calibration = load_calibration(zoo.calibration_file(self.config.weights))
        self._weights = sha256(zoo.weights_file(self.config.weights))
        self._side_by_side = SideBySide()

    @property
    def made_with(self) -> MadeWith:
        """What a calibration has to be made with to hold for this registrar."""
        return MadeWith(self._weights, settings_hash(self.config))

    @property
    def uncalibrated(self) -> str:
        """Why probabilities are not those of these weights and settings; empty if they are."""
        held = self.calibration.made_with
        if held == self.made_with:
            return ''
        if held is None or held.weights != self._weights:
            what = f'weights {self.config.weights!r} have no calibration of their own'
        else:
            what = 'match, estimator, verify or refine are not as in the calibration'
        return (
            f'uncalibrated: {what}, probabilities may be far off; '
            'run `python -m gcl_core.evaluation.calibrate`'
        )

    @property
    def engine(self) -> str:
        """How scans are described on this machine, for the log."""
        like = torch.empty(0, dtype=self.model.dtype, device=self.device)
        instructions = held() if kernels_for(like) else None
        kernels = f'compiled kernels ({instructions.name})' if instructions else 'plain torch'
        if self.device.type != 'cpu':
            kernels += f' on {self.device.type}'
        return f'{str(self.model.dtype).split(".")[1]}, {kernels}'

    @property
    def max_yaw(self) -> float:
        """Largest heading that is left between a turned source and the target, radians."""
        return float((1 + TURN_MARGIN) * np.deg2rad(self.model.config.max_yaw_deg))

    def view(
        self, cloud: PointCloud, T_view_lidar: Float[np.ndarray, '4 4'] | None = None
    ) -> View:
        """Describe a scan, and prepare it for checks and refinement.

        Args:
            cloud: the scan.
            T_view_lidar: what turns it to its street, where that is known.

        Raises:
            GclError: no point lies within the network's range.
        """
        PointCloud.check(cloud)
        if T_view_lidar is None:
            T_view_lidar = self.model.facing(cloud)
        cloud = cloud.moved(T_view_lidar)
        if self.config.headings == 1:
            headings = [Heading(0.0, *self.model.describe([cloud]))]
        else:
            headings = self.model.describe_headings(cloud)
        return View(
            T_view_lidar=T_view_lidar,
            cloud=cloud,
            headings=tuple(headings),
            surface=surface(cloud),
            prepared=prepare(cloud, self.config.refine),
        )

    def views(self, *, source: PointCloud, target: PointCloud) -> tuple[View, View]:
        """Both scans of a pair, prepared side by side.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        PointCloud.check(source, 'source')
        PointCloud.check(target, 'target')
        # Vehicles that face the same way have their street on the same side.
        street = self.model.facing(target) if self.config.headings == 1 else None
        return self._side_by_side(
            lambda: self.view(source, street), lambda: self.view(target, street)
        )

    def register(self, *, source: PointCloud, target: PointCloud) -> Registration:
        """Find the transform that maps source points into the target frame.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        watch = Stopwatch()
        with watch('describe'):
            view, seen = self.views(source=source, target=target)
        return self.register_views(source=view, target=seen, watch=watch)

    def register_views(
        self, *, source: View, target: View, watch: Stopwatch | None = None
    ) -> Registration:
        """Register scans that were prepared by `view`."""
        watch = watch or Stopwatch()
        few = min(len(source.features), len(target.features))
        if few < FEWEST_KEY_POINTS:
            reason = f'a scan has {few} key points, {FEWEST_KEY_POINTS} needed'
            calibrated = not self.uncalibrated
            return Registration(None, 0, 0, reason, watch.stop(), calibrated=calibrated)
        search = self.search(target, watch)
        for look in self.looks(source=source, target=target, watch=watch):
            result = self._decide(look, target, search, watch)
            if result.accepted:
                break
        result = replace(result, headings=len(look.headings), calibrated=not self.uncalibrated)
        return between_lidars(replace(result, ms=watch.stop()), source=source, target=target)

    def looks(
        self, *, source: View, target: View, watch: Stopwatch | None = None
    ) -> Iterator[View]:
        """The source at the headings that are searched, one look after the other.

        First the likeliest quarter turn, then all four, then `config.headings`: where scans do
        not agree on the direction of the street, they are described twice more.
        """
        watch = watch or Stopwatch()
        if self.config.headings == 1:
            with watch('describe'):
                yield replace(source, headings=(self._same_way(source, target),))
            return
        with watch('match'):
            dtype = zoo.dtype_named(self.config.precision)
            headings = likeliest_first(source.headings, target.features, dtype)
        yield replace(source, headings=tuple(headings[:1]))
        yield replace(source, headings=tuple(headings))
        if self.config.headings > len(headings):
            with watch('describe'):
                for yaw in (STEP, 2 * STEP):
                    headings += self.model.describe_headings(source.cloud, yaw)
            yield replace(source, headings=tuple(headings))

    def _same_way(self, source: View, target: View) -> Heading:
        """The source as turned to the target's street, if both vehicles face the same way."""
        yaw = se3.yaw(target.T_view_lidar @ se3.inverse(source.T_view_lidar))
        if abs(yaw) < ALONG:
            return source.headings[0]
        return self.model.describe_headings(source.cloud, yaw)[0]

    def search(self, target: View, watch: Stopwatch) -> Search:
        """What finds hypotheses of a source against a target."""
        return search_for(target.features, self.config, max_yaw=self.max_yaw, watch=watch)

    def hypotheses(self, search: Search, source: View) -> tuple[list[Hypothesis], int]:
        """The best distinct hypotheses at the headings of a source; how many correspondences."""
        found, offered = search.at(source.headings)
        return ranked(found, self.config.verify.hypotheses), offered

    def _decide(
        self, source: View, target: View, search: Search, watch: Stopwatch
    ) -> Registration:
        """Search, check, refine and judge at the headings of a source; between the views."""
        hypotheses, offered = self.hypotheses(search, source)
        if not hypotheses:
            reason = f'no consistent correspondences within {self.config.max_distance:g} m'
            return Registration(None, 0, offered, reason)
        with watch('verify'):
            scene = self.scene(source=source, target=target)
            examined = examine(hypotheses, scene, self.config.verify)
        calibration = self.calibration
        if self.config.min_probability > 0 and nothing_fits(examined, calibration):
            best = hypotheses[int(calibration.estimated.fit.log_odds(examined).argmax())]
            reason = 'probability 0: no hypothesis fits what the scans saw'
            return Registration(best.T_target_source.numpy(), best.inliers, offered, reason)
        with watch('refine'):
            odds = calibration.estimated.choice.log_odds(examined)
            finalists = self.finalists(hypotheses, odds, scene, source=source, target=target)
        winner, columns = summary(finalists, examined, calibration)
        probability = float(calibration.trust.probability(columns))
        if winner.refined.walked or winner.refined.slides:
            probability = 0.0
        return self._verdict(winner, probability, offered)

    def scene(self, *, source: View, target: View) -> Scene:
        """What hypotheses about a pair are checked against."""
        return Scene(
            source=source.surface,
            target=target.surface,
            headings=raised(source.headings),
            keypoints=keypoint_grid(target.features),
            points=min(len(source.cloud), len(target.cloud)),
        )

    def finalists(
        self,
        hypotheses: list[Hypothesis],
        odds: Float[torch.Tensor, ' h'],
        scene: Scene,
        *,
        source: View,
        target: View,
    ) -> list[Finalist]:
        """Refine the hypotheses of the largest odds."""
        config = self.config
        return refine_finalists(
            hypotheses,
            odds,
            scene,
            source=source.prepared,
            target=target.prepared,
            verify=config.verify,
            config=config.refine,
        )

    def _verdict(self, winner: Finalist, probability: float, offered: int) -> Registration:
        """Accept or withhold the winner."""
        reason = ''
        if winner.refined.walked:
            reason = 'refinement does not confirm the place that the correspondences support'
        elif winner.refined.slides:
            reason = 'nothing that both scans saw holds the transform in one direction'
        elif not probability >= self.config.min_probability:  # nor is nan enough
            reason = f'probability {probability:.3f}, {self.config.min_probability:g} needed'
        return Registration(
            T_target_source=winner.refined.T_target_source,
            inliers=winner.inliers,
            correspondences=offered,
            reason=reason,
            accepted=not reason,
            probability=probability,
            covariance=None
            if winner.refined.walked
            else self.calibration.spread.covariance(
                winner.refined.information, winner.refined.residual
            ),
        )


def search_for(
    target: Features, config: RegistrarConfig, *, max_yaw: float, watch: Stopwatch
) -> Search:
    """What finds hypotheses against features of a target, see `Search`."""
    return Search(
        target=target,
        matching=config.match,
        estimator=config.estimator,
        max_distance=config.max_distance,
        max_yaw=max_yaw,
        dtype=zoo.dtype_named(config.precision),
        watch=watch,
    )


def between_lidars(result: Registration, *, source: View, target: View) -> Registration:
    """A registration of views as one of the scans that they were made from."""
    T_lidar_view = se3.inverse(target.T_view_lidar)
    T, covariance = result.T_target_source, result.covariance
    if covariance is not None:
        turn = np.kron(np.eye(2), T_lidar_view[:3, :3])
        covariance = turn @ covariance @ turn.T
    return replace(
        result,
        T_target_source=None if T is None else T_lidar_view @ T @ source.T_view_lidar,
        covariance=covariance,
    )
