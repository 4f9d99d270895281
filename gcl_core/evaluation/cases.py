"""The cases that went worst, with thinned clouds, to be looked at in three dimensions."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcl_core.data.sequence import Sequence as Drive
from gcl_core.evaluation import metrics
from gcl_core.evaluation.predict import Prediction, turned_pair
from gcl_core.ops.voxelize import voxelize
from gcl_core.types import PointCloud

STEP = 0.02  # metres; coordinates are packed as 16-bit numbers of so much, see page/viewer.js
SPACING, MOST = 0.4, 5000  # metres between points shown, and how many of a scan at most


@dataclass(frozen=True)
class Case:
    """A pair to be shown.

    Attributes:
        caption: what it is and how it went.
        source: packed points.
        target: packed points.
        poses: transforms of the source, by what a button says.
    """

    caption: str
    source: str
    target: str
    poses: dict[str, list[list[float]]]


def worst(predictions: Sequence[Prediction], count: int) -> list[Prediction]:
    """Wrong transforms first, the worst before others; then what was not found, the near before
    the far; then what was registered, the least accurate first.
    """

    def rank(p: Prediction) -> tuple[int, float]:
        if p.T_estimated is None:
            return 1, p.pair.distance
        wrong = not metrics.registered(p.T_estimated, p.T_true, metrics.LOOSE)
        return (0 if wrong else 2), -metrics.rte(p.T_estimated, p.T_true)

    return sorted(predictions, key=rank)[:count]


def case(prediction: Prediction, drives: Mapping[str, Drive]) -> Case:
    """Read the scans of a prediction again and pack them.

    Args:
        prediction: of any method.
        drives: by their full names.
    """
    p = prediction
    pair = turned_pair(drives[p.sequence], p.pair, p.turned)
    poses: dict[str, Any] = {'as they came': np.eye(4)}
    if p.T_estimated is not None:
        poses['as estimated'] = p.T_estimated
    poses['true transform'] = p.T_true
    return Case(
        caption=f'{p.sequence} {p.pair.source} to {p.pair.target}, {p.pair.distance:.1f} m, '
        f'{p.method}: {_verdict(p)}',
        source=packed(pair.source),
        target=packed(pair.target),
        poses={name: np.round(T, 5).tolist() for name, T in poses.items()},
    )


def _verdict(p: Prediction) -> str:
    if p.T_estimated is None:
        return 'no transform given'
    errors = f'{metrics.rte(p.T_estimated, p.T_true):.2f} m, '
    errors += f'{metrics.rre_deg(p.T_estimated, p.T_true):.2f}° off'
    loose = metrics.registered(p.T_estimated, p.T_true, metrics.LOOSE)
    return f'registered, {errors}' if loose else f'WRONG, {errors}'


def packed(cloud: PointCloud) -> str:
    """Thin a scan; base64 of little-endian 16-bit x, y, z."""
    points = voxelize([cloud], voxel_size=SPACING, max_range=80.0).points.numpy()
    if len(points) > MOST:
        points = points[np.random.default_rng(0).permutation(len(points))[:MOST]]
    return base64.b64encode((points / STEP).round().astype('<i2').tobytes()).decode()
