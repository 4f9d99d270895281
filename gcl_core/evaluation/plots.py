"""Pictures: two scans from above, before and after; curves of a training run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

SOURCE_COLOR, TARGET_COLOR = '#e8590c', '#1971c2'


def save(figure: object, path: Path) -> None:
    """Write a figure.

    Raises:
        GclError: the picture cannot be written.
    """
    try:
        figure.savefig(path, dpi=110, bbox_inches='tight')  # type: ignore[attr-defined]
    except (OSError, ValueError) as error:
        raise GclError(f'cannot write picture {path}: {error}') from None


def birds_eye(
    path: Path,
    *,
    source: PointCloud,
    target: PointCloud,
    T_target_source: Float[np.ndarray, '4 4'] | None,
    title: str = '',
) -> None:
    """Draw both scans in the target's frame from above, as they came and as registered.

    Raises:
        GclError: the picture cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16, 7))
    registered = 'no transform found' if T_target_source is None else 'registered'
    views = ((None, 'as they came'), (T_target_source, registered))
    for column, (T, name) in enumerate(views):
        axes = figure.add_subplot(1, 2, column + 1)
        moved = source.points if T is None else se3.transform(T, source.points)
        position = np.zeros(3) if T is None else T[:3, 3]
        for points, color, label, sensor in (
            (target.points, TARGET_COLOR, 'target', np.zeros(3)),
            (moved, SOURCE_COLOR, 'source', position),
        ):
            axes.scatter(points[:, 0], points[:, 1], s=0.12, c=color, linewidths=0)
            axes.plot(*sensor[:2], 'o', c=color, ms=9, mec='black', label=label)
        middle = position[:2] / 2
        axes.set_xlim(middle[0] - 65, middle[0] + 65)
        axes.set_ylim(middle[1] - 55, middle[1] + 55)
        axes.set_aspect('equal')
        axes.set_title(name)
        axes.set_xlabel('x, m (target frame)')
        axes.set_ylabel('y, m')
        axes.legend(loc='upper right')
    figure.suptitle(title)
    save(figure, path)


def training_curves(path: Path, log: Path) -> None:
    """Draw loss and top-1 share over steps from a trainer's `log.jsonl`."""
    from matplotlib.figure import Figure

    rows = [json.loads(line) for line in log.read_text().splitlines()]
    if not rows:
        raise GclError(f'{log} is empty; train first')
    figure = Figure(figsize=(11, 4))
    steps = [row['step'] for row in rows]
    for column, key in enumerate(('contrast', 'top1')):
        axes = figure.add_subplot(1, 2, column + 1)
        values = np.array([row[key] for row in rows])
        axes.plot(steps, values, lw=0.4, alpha=0.4)
        window = min(25, len(values))
        smooth = np.convolve(values, np.ones(window) / window, mode='valid')
        axes.plot(steps[window - 1 :], smooth)
        axes.set_xlabel('step')
        axes.set_title(key)
        axes.grid(alpha=0.3)
    save(figure, path)
