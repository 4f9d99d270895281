"""Pictures: two scans from above, before and after; recall over distance."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from collections.abc import Sequence as List
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError, reason_of
from gcl_core.evaluation import metrics
from gcl_core.evaluation.score import Row
from gcl_core.files import check_writable
from gcl_core.types import Correspondences, PointCloud

SOURCE_COLOR, TARGET_COLOR = '#e8590c', '#1971c2'
PICTURES = ('.png', '.jpg', '.pdf', '.svg')
NO_METADATA = dict.fromkeys(('Date', 'Creator', 'Format', 'Type'))  # nor their addresses


def check_picture(path: Path) -> None:
    """See that a picture can be written: before the work, not after.

    Raises:
        GclError: it is of no known format, or cannot be written there.
    """
    if path.suffix.lower() not in PICTURES:
        raise GclError(
            f'picture {path}: unknown format {path.suffix!r}; use {", ".join(PICTURES)}'
        )
    check_writable(path)


def save(figure: object, path: Path) -> None:
    """Write a figure.

    Raises:
        GclError: the picture cannot be written.
    """
    try:
        figure.savefig(path, dpi=110, bbox_inches='tight')  # type: ignore[attr-defined]
    except (OSError, ValueError) as error:
        raise GclError(
            f'cannot write picture {path}: {reason_of(error)}; '
            'give a .png in a folder that is there'
        ) from None


def svg(figure: Any) -> str:
    """A figure as SVG to put into a page; the same figure gives the same text."""
    from matplotlib import rc_context

    file = io.StringIO()
    with rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'gcl'}):
        figure.savefig(file, format='svg', bbox_inches='tight', metadata=NO_METADATA)
    text = file.getvalue()
    return text[text.index('<svg') :]


def recall_over_distance(
    rows: List[Row],
    count: Callable[[Row], int],
    *,
    title: str,
    published: Mapping[str, List[float]] | None = None,
) -> Any:
    """Draw recall of every method against distance with its 95 % Wilson interval.

    Args:
        rows: of one set, by distance.
        count: pairs of a row that are registered.
        title: names set and criterion.
        published: recalls of the paper's five bins by method, percent, drawn dashed.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 4.2))
    axes = figure.add_subplot()
    methods = list(dict.fromkeys(row.method for row in rows))
    for place, method in enumerate(methods):
        own = [row for row in rows if row.method == method and not isinstance(row.bin, str)]
        middles = [(float(r.bin[0]) + float(r.bin[1])) / 2 for r in own]
        x = np.array(middles) + 0.4 * (place - len(methods) / 2)
        y = np.array([count(row) / row.pairs for row in own])
        limits = np.array([metrics.wilson(count(row), row.pairs) for row in own]).reshape(-1, 2)
        bars = np.abs(limits.T - y)
        axes.errorbar(x, 100 * y, 100 * bars, marker='o', ms=4, capsize=2, lw=1.5, label=method)
    for place, (method, values) in enumerate((published or {}).items()):
        x, grey = np.array([7.5, 15, 25, 35, 45]), str(0.3 + 0.1 * (place % 4))
        line = (0, (1 + 2 * (place // 4), 1.5 + place % 4))  # grey, apart by their dashes
        axes.plot(x, values, ls=line, color=grey, lw=1, label=f'{method}, published')
    axes.set(xlabel='distance, m', ylabel='recall, %', ylim=(-2, 102), title=title)
    axes.grid(alpha=0.3)
    lines = axes.get_legend_handles_labels()
    ours_first = sorted(zip(*lines, strict=True), key=lambda line: line[1].endswith('published'))
    axes.legend(
        *zip(*ours_first, strict=True), fontsize=7, loc='center left', bbox_to_anchor=(1.0, 0.5)
    )
    return figure


def birds_eye(
    path: Path,
    *,
    source: PointCloud,
    target: PointCloud,
    T_target_source: Float[np.ndarray, '4 4'] | None,
    matches: Correspondences | None = None,
    title: str = '',
) -> None:
    """Draw both scans in the target's frame from above, as they came and as registered.

    Args:
        path: picture to write.
        source: scan.
        target: scan.
        T_target_source: None draws both as they came.
        matches: correspondences to join by lines.
        title: above both.

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
        if matches is not None:
            _draw_matches(axes, matches, T)
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


def _draw_matches(axes: Any, matches: Correspondences, T: Float[np.ndarray, '4 4'] | None) -> None:
    """Join corresponding points, the source's moved by T."""
    from matplotlib.collections import LineCollection

    source = matches.source.double().numpy()
    moved = source if T is None else se3.transform(T, source)
    lines = np.stack([moved[:, :2], matches.target.double().numpy()[:, :2]], 1)
    axes.add_collection(LineCollection(lines, colors='#2f9e44', linewidths=0.4, alpha=0.6))
