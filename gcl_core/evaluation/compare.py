"""Estimators x features on the same pairs: the best-supported transform of each, refined alike."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np
import torch

from gcl_core.data.pairs import Pair
from gcl_core.data.sequence import Sequence
from gcl_core.estimation.estimators import estimate
from gcl_core.estimation.hypothesis import Hypothesis
from gcl_core.estimation.refine import prepare, refine
from gcl_core.evaluation.peers import fpfh_features
from gcl_core.evaluation.predict import Prediction, turned_pairs
from gcl_core.matching.match import MatchConfig, match
from gcl_core.registrar import Registrar, RegistrarConfig, max_heading
from gcl_core.types import Features, PointCloud

PAPER = 'paper'  # Open3D's RANSAC on the paper's matches: one-way, 5,000 random key points
PAPER_MATCHES = MatchConfig(kind='one_way', keypoints=5000, spread=False)
FEATURES = ('ours', 'fpfh')


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


def compare(
    registrar: Registrar,
    estimators: list[str],
    features: list[str],
    sequence: Sequence,
    pairs: Iterable[Pair],
    *,
    random_yaw_seed: int | None = None,
) -> Iterator[Prediction]:
    """Run every estimator on both kinds of features of every pair.

    The transform is the one of most support, refined by GICP and given whatever its probability.
    Times are those of matching and estimation.
    """
    for p in turned_pairs(sequence, pairs, random_yaw_seed):
        prepared = {
            'source': prepare(p.source, registrar.config.refine),
            'target': prepare(p.target, registrar.config.refine),
        }
        for kind in features:
            described = _describe(registrar, kind, p.source, p.target)
            for name in estimators:
                began = time.perf_counter()
                best = best_hypothesis(*described, settings(registrar.config, name))
                seconds = time.perf_counter() - began
                T = None
                if best is not None:
                    start = best.T_target_source.numpy()
                    refined = refine(start, **prepared, config=registrar.config.refine)
                    T = refined.T_target_source
                label = f'{kind} + {name}'
                yield Prediction(label, sequence.name, p.pair, p.turned, p.T_true, T, seconds)


def _describe(
    registrar: Registrar, kind: str, source: PointCloud, target: PointCloud
) -> tuple[list[Features], torch.Tensor, Features]:
    """Features of the source at its headings, the headings, features of the target."""
    if kind == 'fpfh':  # does not depend on the heading
        return [fpfh_features(source)], torch.eye(4).double()[None], fpfh_features(target)
    view = registrar.view(source, turns=registrar.config.turns)
    return view.headings, view.turns, registrar.view(target).headings[0]
