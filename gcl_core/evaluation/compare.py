"""Estimators x features on the same pairs: the best-supported transform of each, refined alike."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import torch

from gcl_core.estimation.estimators import estimate
from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.refine import prepare, refine
from gcl_core.evaluation.peers import fpfh_features
from gcl_core.evaluation.predict import Outcome
from gcl_core.matching.match import MatchConfig, match
from gcl_core.registrar import Registrar, RegistrarConfig, max_heading
from gcl_core.types import Features, PointCloud

PAPER = 'paper'  # Open3D's RANSAC on the paper's matches: one-way, 5,000 random key points
PAPER_MATCHES = MatchConfig(kind='one_way', keypoints=5000, spread=False)


def settings(config: RegistrarConfig, estimator: str) -> RegistrarConfig:
    """The registrar's settings with another estimator."""
    if estimator == PAPER:
        chosen = replace(config.estimator, name='open3d_ransac')
        return replace(config, estimator=chosen, match=PAPER_MATCHES)
    chosen = replace(config.estimator, name=cast(Any, estimator))
    return replace(config, estimator=chosen)


def best_hypothesis(
    headings: list[Features], turns: torch.Tensor, target: Features, config: RegistrarConfig
) -> Hypothesis | None:
    """Match and estimate at every heading; the hypothesis of most support."""
    limit = max_heading(len(headings)) if len(headings) > 1 else np.pi
    found = []
    for features, turn in zip(headings, turns):
        matches = match(source=features, target=target, config=config.match)
        for h in estimate(matches, config.estimator, max_yaw=limit):
            found.append(Hypothesis(h.T_target_source @ turn, h.score, h.inliers))
    return max(found, key=lambda h: h.score, default=None)


@dataclass(frozen=True)
class Comparison:
    """Runs every estimator on every kind of features of a pair; a `predict.Contestant`.

    The transform is the one of most support, refined by GICP and given whatever its probability.
    Times are those of matching and estimation.

    Attributes:
        registrar: describes, and gives the settings.
        estimators: names.
        features: `ours`, `fpfh` or both.
    """

    registrar: Registrar
    estimators: tuple[str, ...]
    features: tuple[str, ...]

    def __call__(self, source: PointCloud, target: PointCloud) -> Iterator[Outcome]:
        """Yield an outcome for each kind of features and each estimator."""
        config = self.registrar.config
        prepared = {
            'source': prepare(source, config.refine),
            'target': prepare(target, config.refine),
        }
        for kind in self.features:
            described = _describe(self.registrar, kind, source, target)
            for name in self.estimators:
                began = time.perf_counter()
                best = best_hypothesis(*described, settings(config, name))
                seconds = time.perf_counter() - began
                T = None
                if best is not None:
                    start = best.T_target_source.numpy()
                    T = refine(start, **prepared, config=config.refine).T_target_source
                yield Outcome(f'{kind} + {name}', T, seconds)


def _describe(
    registrar: Registrar, kind: str, source: PointCloud, target: PointCloud
) -> tuple[list[Features], torch.Tensor, Features]:
    """Features of the source at its headings, the headings, features of the target."""
    if kind == 'fpfh':  # does not depend on the heading
        return [fpfh_features(source)], torch.eye(4).double()[None], fpfh_features(target)
    view = registrar.view(source, turns=registrar.config.turns)
    return view.headings, view.turns, registrar.view(target).headings[0]
