"""A pair of scans to a registration: voxelize, describe, match, estimate, refine."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import torch

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.estimation.ransac import RansacConfig, distinct, ransac
from gcl_core.estimation.refine import RefineConfig, prepare, refine
from gcl_core.matching.mutual import match_mutual
from gcl_core.models import zoo
from gcl_core.types import Features, PointCloud, Registration

BEARABLE_YAW = np.deg2rad(40.0)  # between two scans; trained with up to 25 degrees on each
TURN_MARGIN = np.deg2rad(25.0)  # beyond half a turn step, headings are another turn's business


@dataclass(frozen=True)
class RegistrarConfig:
    """What happens between two scans and a transform.

    Attributes:
        weights: a shipped name or a file.
        turns: headings at which the source is described. The shipped weights bear about 40
            degrees between two vehicles: 1 is for vehicles that face the same way, 6 for any.
        min_inliers: correspondences that must agree for a transform to be reported.
        min_lead: how many times as many as for the best other place.
        ransac: search for the transform.
        refine: GICP afterwards.
    """

    weights: str = zoo.DEFAULT
    turns: int = 6
    min_inliers: int = 20
    min_lead: float = 1.5
    ransac: RansacConfig = field(default_factory=RansacConfig)
    refine: RefineConfig = field(default_factory=RefineConfig)

    def __post_init__(self) -> None:
        if self.turns < 1:
            raise GclError(f'turns is {self.turns}; it must be at least 1')


class Registrar:
    """Registers pairs of scans; holds the network and nothing about any scan."""

    def __init__(self, config: RegistrarConfig | None = None) -> None:
        self.config = config or RegistrarConfig()
        self.model = zoo.load_weights(self.config.weights)
        self.model.dtype = zoo.best_dtype()

    def describe(self, cloud: PointCloud) -> Features:
        """Describe one scan."""
        return self.model.describe([cloud])[0]

    def describe_turned(self, cloud: PointCloud) -> list[tuple[np.ndarray, Features]]:
        """Describe a scan at every heading; returns (T_turned_lidar, features in that frame)."""
        headings = 2 * np.pi * np.arange(self.config.turns) / self.config.turns
        turns = [se3.from_xyz_rpy(yaw=float(heading)) for heading in headings]
        return [
            (turn, self.describe(PointCloud(se3.transform(turn, cloud.points)))) for turn in turns
        ]

    def register(self, *, source: PointCloud, target: PointCloud) -> Registration:
        """Find the transform that maps source points into the target frame.

        Raises:
            GclError: a cloud has no point within the network's range.
        """
        watch = Stopwatch()
        with watch('describe'):
            target_features = self.describe(target)
            turned_features = self.describe_turned(source)
        leaders = self._search(turned_features, target_features, watch)
        inliers = leaders[0].inliers if leaders else 0
        offered = leaders[0].offered if leaders else 0
        reason = self._doubt(leaders)
        if reason:
            return Registration(None, inliers, offered, reason, watch.stop())
        with watch('refine'):
            config = self.config.refine
            clouds = {'source': prepare(source, config), 'target': prepare(target, config)}
            T = refine(leaders[0].T_target_source, **clouds, config=config)
        return Registration(T, inliers, offered, '', watch.stop())

    def _search(
        self,
        turned: list[tuple[np.ndarray, Features]],
        target: Features,
        watch: Stopwatch,
    ) -> list[_Candidate]:
        """Match and estimate at every heading; return all hypotheses, most support first."""
        max_yaw = min(np.pi / self.config.turns, BEARABLE_YAW) + TURN_MARGIN
        candidates = []
        for T_turned_lidar, source in turned:
            with watch('match'):
                matches = match_mutual(source=source, target=target)
            with watch('estimate'):
                hypotheses = ransac(matches, self.config.ransac, max_yaw=max_yaw)
            for h in hypotheses:
                T = h.T_target_source.numpy() @ T_turned_lidar
                candidates.append(_Candidate(T, h.score, h.inliers, len(matches)))
        return sorted(candidates, key=lambda c: -c.score)

    def _doubt(self, candidates: list[_Candidate]) -> str:
        """Why the best hypothesis is not to be trusted; empty if it is."""
        config = self.config
        if not candidates:
            return 'no consistent correspondences'
        best = candidates[0]
        if best.inliers < config.min_inliers:
            return f'{best.inliers} inliers, {config.min_inliers} needed'
        place = torch.from_numpy(best.T_target_source)
        rival = next(
            (c for c in candidates if distinct(torch.from_numpy(c.T_target_source), place)), None
        )
        if rival and best.inliers < config.min_lead * rival.inliers:
            return (
                f'{best.inliers} inliers, another place has {rival.inliers}: '
                f'less than {config.min_lead:g} times as many'
            )
        return ''


@dataclass(frozen=True)
class _Candidate:
    """A hypothesis in the source's own frame, and the correspondences offered at its heading."""

    T_target_source: np.ndarray
    score: float
    inliers: int
    offered: int


class Stopwatch:
    """Adds up milliseconds by stage name."""

    def __init__(self) -> None:
        self._began = time.perf_counter()
        self._ms: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a block; a stage may come several times."""
        began = time.perf_counter()
        yield
        self._ms[stage] = self._ms.get(stage, 0.0) + 1e3 * (time.perf_counter() - began)

    def stop(self) -> dict[str, float]:
        """Return the stages and `total`, the time since the watch was made."""
        total = 1e3 * (time.perf_counter() - self._began)
        return {stage: round(ms, 1) for stage, ms in {**self._ms, 'total': total}.items()}
