"""Estimators x features on the same pairs: the best-supported transform of each, refined alike."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.estimation.refine import prepare, refine
from gcl_core.evaluation.peers import fpfh_features
from gcl_core.evaluation.predict import Outcome
from gcl_core.matching.match import MatchConfig
from gcl_core.registrar import Registrar, RegistrarConfig, search_for
from gcl_core.stopwatch import Stopwatch
from gcl_core.types import Features, Heading, PointCloud

PAPER = 'paper'  # Open3D's RANSAC on the paper's matches: one-way, 5,000 random key points
PAPER_MATCHES = MatchConfig(kind='one_way', keypoints=5000, spread=False)


def settings(config: RegistrarConfig, estimator: str) -> RegistrarConfig:
    """The registrar's settings with another estimator."""
    if estimator == PAPER:
        chosen = replace(config.estimator, name='open3d_ransac')
        return replace(config, estimator=chosen, match=PAPER_MATCHES)
    chosen = replace(config.estimator, name=cast(Any, estimator))
    return replace(config, estimator=chosen)


@dataclass(frozen=True)
class Described:
    """Both scans of a pair, described by one kind of features.

    Attributes:
        headings: of the source, in its view frame.
        target: features, in its view frame.
        T_view_source, T_view_target: what leads to those frames.
        max_yaw: largest heading that is left between a turned source and the target, radians.
    """

    headings: tuple[Heading, ...]
    target: Features
    T_view_source: Float[np.ndarray, '4 4']
    T_view_target: Float[np.ndarray, '4 4']
    max_yaw: float


def best_hypothesis(pair: Described, config: RegistrarConfig) -> Float[np.ndarray, '4 4'] | None:
    """Match and estimate at every heading; T_target_source of most support."""
    max_yaw = np.pi if config.match == PAPER_MATCHES else pair.max_yaw  # the paper has no limit
    search = search_for(pair.target, config, max_yaw=max_yaw, watch=Stopwatch())
    found, _ = search.at(pair.headings)
    if not found:
        return None
    T = max(found, key=lambda hypothesis: hypothesis.score).T_target_source.numpy()
    return np.asarray(se3.inverse(pair.T_view_target) @ T @ pair.T_view_source)


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
            described = describe(self.registrar, kind, source, target)
            for name in self.estimators:
                began = time.perf_counter()
                T = best_hypothesis(described, settings(config, name))
                seconds = time.perf_counter() - began
                if T is not None:
                    T = refine(T, **prepared, config=config.refine).T_target_source
                yield Outcome(f'{kind} + {name}', T, seconds)


def describe(registrar: Registrar, kind: str, source: PointCloud, target: PointCloud) -> Described:
    """Describe a pair by `ours` or `fpfh`."""
    if kind == 'fpfh':  # does not depend on the heading
        alone = (Heading(0.0, fpfh_features(source)),)
        return Described(alone, fpfh_features(target), np.eye(4), np.eye(4), np.pi)
    view, seen = registrar.views(source=source, target=target)
    *_, every = registrar.looks(source=view, target=seen)
    return Described(
        headings=every.headings,
        target=seen.features,
        T_view_source=view.T_view_lidar,
        T_view_target=seen.T_view_lidar,
        max_yaw=registrar.max_yaw,
    )
