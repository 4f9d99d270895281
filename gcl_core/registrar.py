"""A pair of scans to a registration: describe, match, estimate, verify, refine, judge."""

from __future__ import annotations

import hashlib
import json
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
from gcl_core.estimation.estimators import EstimatorConfig, estimate
from gcl_core.estimation.evidence import Scene
from gcl_core.estimation.hypothesis import Hypothesis, ranked
from gcl_core.estimation.likeness import keypoint_grid, raised
from gcl_core.estimation.refine import RefineConfig
from gcl_core.files import sha256
from gcl_core.matching.match import MatchConfig, match
from gcl_core.models import zoo
from gcl_core.ops.native.instructions import held
from gcl_core.ops.native.kernels import kernels_for
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Features, PointCloud, Registration
from gcl_core.view import View, undescribed

FEWEST_KEY_POINTS = 100  # anything fits a handful of points
TURN_MARGIN = 0.6  # of what weights bear: beyond it, headings are another turn's business


@dataclass(frozen=True)
class RegistrarConfig:
    """What happens between two scans and a transform.

    Attributes:
        weights: `gcl_conv`, `gcl_kpconv` (more right matches, slower), or a file.
        precision: of the network and of the search in feature space: `bfloat16`, `float32`, or
            `auto`: bfloat16 where one instruction multiplies it.
        turns: headings at which the source is described. The shipped weights bear about 16
            degrees between two scans: 12 find any heading, 1 is for vehicles that face the same
            way.
        first_turns: headings that are tried first, the others only if nothing is accepted. Where
            both scans agree on the direction of the street, 4 are enough.
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
    precision: Literal['auto', 'bfloat16', 'float32'] = 'auto'
    turns: int = 12
    first_turns: int = 4
    max_distance: float = 80.0
    min_probability: float = 0.9
    match: MatchConfig = field(default_factory=MatchConfig)
    estimator: EstimatorConfig = field(default_factory=EstimatorConfig)
    verify: VerifyConfig = field(default_factory=VerifyConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)

    def __post_init__(self) -> None:
        for name in ('turns', 'first_turns'):
            if getattr(self, name) < 1:
                raise GclError(f'{name} is {getattr(self, name)}; it must be at least 1')
        zoo.dtype_named(self.precision)
        if not self.max_distance > 0:
            raise GclError(f'max_distance is {self.max_distance}; it must be positive, metres')
        if not 0 <= self.min_probability <= 1:
            raise GclError(f'min_probability is {self.min_probability}; it must lie in [0, 1]')

    @property
    def looks(self) -> tuple[int, ...]:
        """Headings to describe the source at, again with more while nothing is accepted."""
        few = (self.first_turns,) if self.first_turns < self.turns else ()
        return (*few, self.turns)


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
        self.model = zoo.load_weights(self.config.weights)
        self.model.dtype = zoo.dtype_named(self.config.precision)
        self.calibration = load_calibration(zoo.calibration_file(self.config.weights))
        self._weights = sha256(zoo.weights_file(self.config.weights))

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
        instructions = held() if kernels_for(torch.empty(0, dtype=self.model.dtype)) else None
        kernels = f'compiled kernels ({instructions.name})' if instructions else 'plain torch'
        return f'{str(self.model.dtype).split(".")[1]}, {kernels}'

    def max_heading(self, turns: int) -> float:
        """Largest heading that is searched for at each of so many turns, radians."""
        bearable = np.deg2rad(self.model.config.max_yaw_deg)
        return float(min(np.pi / turns, bearable) + TURN_MARGIN * bearable)

    def first_yaw(self, *, source: View, target: View) -> float:
        """Yaw of the source's first turn; where it is the only one, both face the same way."""
        same_way = se3.yaw(target.T_view_lidar @ se3.inverse(source.T_view_lidar))
        return same_way if self.config.turns == 1 else 0.0

    def view(
        self,
        cloud: PointCloud,
        *,
        turns: int = 1,
        yaw: float = 0.0,
        known: View | None = None,
    ) -> View:
        """Describe a scan at evenly spaced headings, and prepare it for checks and refinement.

        Args:
            cloud: the scan.
            turns: how many headings.
            yaw: of the first turn, radians: where the target's view is known to be turned so
                against this one's, one heading is enough.
            known: another view of this scan; what it has of this one is not made again.

        Raises:
            GclError: no point lies within the network's range.
        """
        PointCloud.check(cloud)
        known = known or self._undescribed(cloud)
        yaws = [yaw + 2 * np.pi * k / turns for k in range(turns)]
        matrices = [se3.from_xyz_rpy(yaw=yaw) for yaw in yaws]
        made = {T.numpy().tobytes(): f for T, f in zip(known.turns, known.headings)}
        missing = [k for k, T in enumerate(matrices) if T.tobytes() not in made]
        still = cloud.moved(known.T_view_lidar)
        described = self.model.describe_turned(still, [yaws[k] for k in missing])
        made.update((matrices[k].tobytes(), f) for k, f in zip(missing, described, strict=True))
        return replace(
            known,
            headings=[made[T.tobytes()] for T in matrices],
            turns=torch.from_numpy(np.stack(matrices)),
        )

    def _undescribed(self, cloud: PointCloud) -> View:
        PointCloud.check(cloud)
        return undescribed(cloud, self.model.facing(cloud), self.config.refine)

    def views(self, *, source: PointCloud, target: PointCloud) -> tuple[View, View]:
        """Prepare both scans of a pair, the source at all headings.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        seen = self.view(target)
        known = self._undescribed(source)
        yaw = self.first_yaw(source=known, target=seen)
        return self.view(source, turns=self.config.turns, yaw=yaw, known=known), seen

    def register(self, *, source: PointCloud, target: PointCloud) -> Registration:
        """Find the transform that maps source points into the target frame.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        return self.register_seen(source=source, target=target)[0]

    def register_seen(
        self, *, source: PointCloud, target: PointCloud
    ) -> tuple[Registration, View, View]:
        """Register; also return source and target as they were described, for pictures."""
        PointCloud.check(source, 'source')
        PointCloud.check(target, 'target')
        watch = Stopwatch()
        with watch('describe'):
            seen = self.view(target)
            view = self._undescribed(source)
        yaw = self.first_yaw(source=view, target=seen)
        for turns in self.config.looks:
            with watch('describe'):
                view = self.view(source, turns=turns, yaw=yaw, known=view)
            result = self.register_views(source=view, target=seen, watch=watch)
            if result.accepted:
                break
        return result, view, seen

    def register_views(
        self, *, source: View, target: View, watch: Stopwatch | None = None
    ) -> Registration:
        """Register scans that were prepared by `view`, the source at all headings."""
        result = self._register_views(source, target, watch or Stopwatch())
        return replace(result, calibrated=not self.uncalibrated)

    def _register_views(self, source: View, target: View, watch: Stopwatch) -> Registration:
        few = min(len(source.headings[0]), len(target.headings[0]))
        if few < FEWEST_KEY_POINTS:
            reason = f'a scan has {few} key points, {FEWEST_KEY_POINTS} needed'
            return Registration(None, 0, 0, reason, watch.stop())
        hypotheses, offered = self.search(source=source, target=target, watch=watch)
        if not hypotheses:
            reason = f'no consistent correspondences within {self.config.max_distance:g} m'
            return Registration(None, 0, offered, reason, watch.stop())
        with watch('verify'):
            scene = self.scene(source=source, target=target)
            examined = examine(hypotheses, scene, self.config.verify)
        calibration = self.calibration
        if self.config.min_probability > 0 and nothing_fits(examined, calibration):
            best = hypotheses[int(calibration.estimated.fit.log_odds(examined).argmax())]
            reason = 'probability 0: no hypothesis fits what the scans saw'
            T = best.T_target_source.numpy()
            result = Registration(T, best.inliers, offered, reason, watch.stop())
            return between_lidars(result, source=source, target=target)
        with watch('refine'):
            odds = calibration.estimated.choice.log_odds(examined)
            finalists = self.finalists(hypotheses, odds, scene, source=source, target=target)
        winner, columns = summary(finalists, examined, calibration)
        probability = float(calibration.trust.probability(columns))
        if winner.refined.walked or winner.refined.slides:
            probability = 0.0
        result = self._verdict(winner, probability, offered, watch)
        return between_lidars(result, source=source, target=target)

    def search(
        self, *, source: View, target: View, watch: Stopwatch
    ) -> tuple[list[Hypothesis], int]:
        """Match and estimate at every heading.

        Returns the best distinct hypotheses between the views, most support first, none beyond
        `max_distance`, and how many correspondences there were at all headings.
        """
        found, offered = search_headings(
            source.headings,
            source.turns,
            target.headings[0],
            self.config,
            max_yaw=self.max_heading(len(source.headings)),
            watch=watch,
        )
        return ranked(found, self.config.verify.hypotheses), offered

    def scene(self, *, source: View, target: View) -> Scene:
        """What hypotheses about a pair are checked against."""
        return Scene(
            source=source.surface,
            target=target.surface,
            headings=[raised(features) for features in source.headings],
            turns=source.turns,
            keypoints=keypoint_grid(target.headings[0]),
            points=min(source.points, target.points),
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

    def _verdict(
        self,
        winner: Finalist,
        probability: float,
        offered: int,
        watch: Stopwatch,
    ) -> Registration:
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
            ms=watch.stop(),
            accepted=not reason,
            probability=probability,
            covariance=None
            if winner.refined.walked
            else self.calibration.spread.covariance(
                winner.refined.information, winner.refined.residual
            ),
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


def search_headings(
    headings: list[Features],
    turns: Float[torch.Tensor, 'turns 4 4'],
    target: Features,
    config: RegistrarConfig,
    *,
    max_yaw: float,
    watch: Stopwatch,
) -> tuple[list[Hypothesis], int]:
    """Match and estimate at every heading.

    Args:
        headings: features of the source in the frames turned by `turns`.
        turns: T_turned_source of each heading.
        target: features of the target.
        config: settings of match and estimator, and the farthest that is wanted.
        max_yaw: largest heading that is left between a turned source and the target, radians.
        watch: times both.

    Returns:
        Hypotheses in the order of headings, and how many correspondences there were.
    """
    found, offered = [], 0
    for features, T_turned_source in zip(headings, turns, strict=True):
        with watch('match'):
            dtype = zoo.dtype_named(config.precision)
            matches = match(source=features, target=target, config=config.match, dtype=dtype)
        offered += len(matches)
        with watch('estimate'):
            for h in estimate(matches, config.estimator, max_yaw=max_yaw):
                T = h.T_target_source @ T_turned_source
                if T[:3, 3].norm() <= config.max_distance:
                    found.append(Hypothesis(T, h.score, h.inliers))
    return found, offered
