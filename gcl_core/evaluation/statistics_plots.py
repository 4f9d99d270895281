"""Pictures of scans and of their statistics side by side."""

from __future__ import annotations

from collections.abc import Sequence as List
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core.evaluation.plots import save
from gcl_core.evaluation.statistics import RINGS, ScanStatistics
from gcl_core.types import PointCloud


@dataclass(frozen=True)
class Sample:
    """Statistics of scans of one origin, and some of them to look at.

    Attributes:
        name: for the legend.
        scans: statistics of each scan.
        groups: group share of each centre.
        pictures: scans to draw.
    """

    name: str
    scans: list[ScanStatistics]
    groups: list[float]
    pictures: list[PointCloud]


def draw_scan(axes: Any, cloud: PointCloud, reach: float = 60.0) -> None:
    """Draw a scan from above, coloured by height from 3 m below to 6 m above the sensor."""
    points = cloud.points[np.argsort(cloud.points[:, 2])]
    height = np.clip(points[:, 2], -3.0, 6.0)
    axes.scatter(points[:, 0], points[:, 1], s=0.25, c=height, cmap='turbo', linewidths=0)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect('equal')


def comparison(path: Path, samples: List[Sample]) -> None:
    """Draw the samples' statistics by range over each other, and their scans below.

    Raises:
        GclError: the picture cannot be written.
    """
    from matplotlib.figure import Figure

    pictures = [(sample.name, cloud) for sample in samples for cloud in sample.pictures]
    rows = 1 + -(-len(pictures) // 4)
    figure = Figure(figsize=(14, 4 * rows))
    middle = (RINGS[:-1] + RINGS[1:]) / 2
    for column, (field, title, log) in enumerate(
        (
            ('points', 'points in a ring of 10 m', True),
            ('voxels', 'voxels (0.3 m) in a ring', True),
            ('neighbors', 'occupied of 27 neighbours', False),
        )
    ):
        axes = figure.add_subplot(rows, 4, column + 1)
        for number, sample in enumerate(samples):
            values = np.array([getattr(scan, field) for scan in sample.scans], dtype=float)
            low, mean, high = np.nanpercentile(values, [10, 50, 90], axis=0)
            axes.plot(middle, mean, color=f'C{number}', label=sample.name, marker='.')
            axes.fill_between(middle, low, high, color=f'C{number}', alpha=0.12, linewidth=0)
        axes.set_title(title + '\nmedian, 10 to 90 % of scans', fontsize=10)
        axes.set_xlabel('range, m')
        if log:
            axes.set_yscale('log')
        axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    axes = figure.add_subplot(rows, 4, 4)
    axes.boxplot([100 * np.array(s.groups) for s in samples], whis=(0, 100))
    axes.set_xticks(range(1, len(samples) + 1), [s.name for s in samples], rotation=30, fontsize=7)
    axes.set_title('points that form a group, %', fontsize=10)
    axes.grid(alpha=0.3)
    for number, (name, cloud) in enumerate(pictures):
        axes = figure.add_subplot(rows, 4, 5 + number)
        draw_scan(axes, cloud)
        axes.set_title(f'{name}: {len(cloud)} points', fontsize=8)
    figure.tight_layout()
    save(figure, path)


def scan_picture(path: Path, clouds: List[tuple[str, PointCloud]]) -> None:
    """Draw scans side by side from above.

    Raises:
        GclError: the picture cannot be written.
    """
    from matplotlib.figure import Figure

    columns = min(len(clouds), 4)
    rows = -(-len(clouds) // columns)
    figure = Figure(figsize=(7 * columns, 7 * rows))
    for number, (title, cloud) in enumerate(clouds):
        axes = figure.add_subplot(rows, columns, number + 1)
        draw_scan(axes, cloud)
        axes.set_title(title)
    save(figure, path)
