"""`gcl register SOURCE TARGET`: where the source stands in the target's frame."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.cli.outcome import Answer
from gcl_core.config import load_config
from gcl_core.data.clouds import read_cloud, write_cloud
from gcl_core.evaluation.agreement import agreeing
from gcl_core.evaluation.plots import birds_eye
from gcl_core.evaluation.recording import record
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.to_json import to_json
from gcl_core.types import PointCloud, Registration


def run(options: argparse.Namespace) -> Answer:
    """Register; the code is 1 when no transform was accepted."""
    config = load_config(RegistrarConfig, options.config) if options.config else None
    source, target = read_cloud(options.source), read_cloud(options.target)
    registrar = Registrar(config)
    result = registrar.register(source=source, target=target)
    T = result.T_target_source
    if options.aligned and T is not None:
        write_cloud(options.aligned, PointCloud(se3.transform(T, source.points)))
    if options.picture or options.rerun:
        _show(options, registrar, source, target, T)
    text = to_json(_summary(result)) if options.json else _text(result)
    return Answer(text, 0 if result.accepted else 1)


def _show(
    options: argparse.Namespace,
    registrar: Registrar,
    source: PointCloud,
    target: PointCloud,
    T: np.ndarray | None,
) -> None:
    """Draw and record the pair with the matches that agree."""
    matches = None
    if T is not None:
        turned, still = registrar.views(source=source, target=target)
        matches = agreeing(T, source=turned, target=still, config=registrar.config.match)
    clouds = {'source': source, 'target': target}
    pair: dict[str, Any] = {**clouds, 'T_target_source': T, 'matches': matches}
    if options.picture:
        title = f'{options.source.name} in the frame of {options.target.name}'
        birds_eye(options.picture, **pair, title=title)
    if options.rerun:
        record(options.rerun, **pair)


def _summary(result: Registration) -> dict[str, Any]:
    return {
        'T_target_source': result.T_target_source,
        'accepted': result.accepted,
        'probability': result.probability,
        'covariance': result.covariance,
        'inliers': result.inliers,
        'ms': result.ms,
        **({} if result.accepted else {'reason': result.reason}),
    }


def _text(result: Registration) -> str:
    times = ', '.join(f'{stage} {ms:.0f}' for stage, ms in result.ms.items())
    T = result.T_target_source
    if T is None:
        return f'no transform found: {result.reason}\nms        {times}'
    verdict = 'accepted' if result.accepted else f'NOT ACCEPTED: {result.reason}'
    with np.printoptions(precision=4, suppress=True):
        return (
            f'T_target_source\n{T}\n'
            f'distance  {np.linalg.norm(T[:3, 3]):.2f} m, yaw {np.rad2deg(se3.yaw(T)):.2f} deg\n'
            f'{_accuracy(result)}'
            f'right     with probability {result.probability:.4f}; {verdict}\n'
            f'inliers   {result.inliers} of {result.correspondences}\nms        {times}'
        )


def _accuracy(result: Registration) -> str:
    if result.covariance is None:
        return ''
    deviation = np.sqrt(np.diag(result.covariance))
    metres = ', '.join(f'{v:.3f}' for v in deviation[:3])
    degrees = ', '.join(f'{v:.3f}' for v in np.rad2deg(deviation[3:]))
    return f'deviation {metres} m, {degrees} deg about x, y, z\n'
