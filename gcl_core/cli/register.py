"""`gcl register SOURCE TARGET`: where the source stands in the target's frame."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from gcl_core import se3
from gcl_core.cli.outcome import Answer
from gcl_core.config import load_config
from gcl_core.data.bin_layout import BinLayout, told_layout
from gcl_core.data.clouds import (
    bin_layout,
    known_format,
    read_cloud,
    writable_format,
    write_cloud,
)
from gcl_core.errors import GclError
from gcl_core.evaluation.agreement import agreeing
from gcl_core.evaluation.plots import birds_eye, check_picture
from gcl_core.evaluation.recording import check_recording, record
from gcl_core.files import check_writable
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.to_json import to_json
from gcl_core.types import Registration


def run(options: argparse.Namespace) -> Answer:
    """Register; the code is 1 when no transform was accepted."""
    _check_outputs(options)
    config = load_config(RegistrarConfig, options.config) if options.config else None
    layouts = _layouts(options)
    source, target = (
        read_cloud(path, layouts[side])
        for side, path in (('source', options.source), ('target', options.target))
    )
    registrar = Registrar(config)
    views = registrar.views(source=source, target=target)
    result = registrar.register_views(source=views[0], target=views[1])
    T = result.T_target_source
    if options.aligned and T is not None:
        write_cloud(options.aligned, source.moved(T))
    if options.picture or options.rerun:
        matches = None
        if T is not None:
            matches = agreeing(registrar, T, source=views[0], target=views[1])
        _show(options, source=source, target=target, T_target_source=T, matches=matches)
    text = to_json(_summary(result, layouts)) if options.json else _text(result)
    return Answer(text, 0 if result.accepted else 1)


def _check_outputs(options: argparse.Namespace) -> None:
    """See that every file can be written, before the work."""
    if options.aligned:
        writable_format(options.aligned)
        check_writable(options.aligned)
    if options.picture:
        check_picture(options.picture)
    if options.rerun:
        check_recording(options.rerun)


def _layouts(options: argparse.Namespace) -> dict[str, BinLayout | None]:
    """Columns of each scan that is a .bin."""
    told = told_layout(options.columns)
    layouts: dict[str, BinLayout | None] = {}
    for side in ('source', 'target'):
        path = getattr(options, side)
        binary = known_format(path) == '.bin' and path.stat().st_size > 0
        layouts[side] = (told or bin_layout(path)) if binary else None
    if told and not any(layouts.values()):
        raise GclError(f'--columns {options.columns} is of a .bin, and neither scan is one')
    return layouts


def _show(options: argparse.Namespace, **pair: Any) -> None:
    """Draw and record the pair with the matches that agree."""
    if options.picture:
        title = f'{options.source.name} in the frame of {options.target.name}'
        birds_eye(options.picture, **pair, title=title)
    if options.rerun:
        record(options.rerun, **pair)


def _summary(result: Registration, layouts: dict[str, BinLayout | None]) -> dict[str, Any]:
    return {
        'columns': {side: str(layout) for side, layout in layouts.items() if layout},
        'T_target_source': result.T_target_source,
        'accepted': result.accepted,
        'probability': result.probability,
        'calibrated': result.calibrated,
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
            f'right     with probability {result.probability:.4f}'
            f'{"" if result.calibrated else " (uncalibrated)"}; {verdict}\n'
            f'inliers   {result.inliers} of {result.correspondences}\nms        {times}'
        )


def _accuracy(result: Registration) -> str:
    if result.covariance is None:
        return ''
    deviation = np.sqrt(np.diag(result.covariance))
    metres = ', '.join(f'{v:.3f}' for v in deviation[:3])
    degrees = ', '.join(f'{v:.3f}' for v in np.rad2deg(deviation[3:]))
    return f'deviation {metres} m, {degrees} deg about x, y, z\n'
