"""From two described scans to hypotheses, heading by heading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch

from gcl_core import se3
from gcl_core.estimation.estimators import EstimatorConfig, estimate
from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.matching.match import MatchConfig, match
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Features, Heading


@dataclass
class Search:
    """Matches and estimates at headings of a source; none is searched twice.

    Attributes:
        target: features.
        matching: settings.
        estimator: settings.
        max_distance: between the sensors, metres; hypotheses beyond it are left out.
        max_yaw: largest heading that is left between a turned source and the target, radians.
        dtype: in which descriptors are compared.
        watch: times `match` and `estimate`.
    """

    target: Features
    matching: MatchConfig
    estimator: EstimatorConfig
    max_distance: float
    max_yaw: float
    dtype: torch.dtype
    watch: Stopwatch
    _found: dict[float, tuple[list[Hypothesis], int]] = field(default_factory=dict, init=False)

    def at(self, headings: Sequence[Heading]) -> tuple[list[Hypothesis], int]:
        """Hypotheses at all of some headings, in their order; how many correspondences."""
        for heading in headings:
            if heading.yaw not in self._found:
                self._found[heading.yaw] = self._at(heading)
        found = [self._found[heading.yaw] for heading in headings]
        return [h for hypotheses, _ in found for h in hypotheses], sum(n for _, n in found)

    def _at(self, heading: Heading) -> tuple[list[Hypothesis], int]:
        T = se3.from_xyz_rpy(yaw=heading.yaw)
        points = torch.from_numpy(se3.transform(T, heading.features.points.numpy()))
        turned = Features(points, heading.features.descriptors)
        with self.watch('match'):
            matches = match(
                source=turned, target=self.target, config=self.matching, dtype=self.dtype
            )
        with self.watch('estimate'):
            found = estimate(matches, self.estimator, max_yaw=self.max_yaw)
        T_turned_source = torch.from_numpy(T)
        moved = (
            Hypothesis(h.T_target_source @ T_turned_source, h.score, h.inliers) for h in found
        )
        near = [h for h in moved if h.T_target_source[:3, 3].norm() <= self.max_distance]
        return near, len(matches)
