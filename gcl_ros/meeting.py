"""Two vehicles meet in a simulated street; the node tells where they stand.

Writes a small bag, starts `registrar` and `replay` as processes of their own, listens to both and
prints a row for each pair.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gcl_core import se3
from gcl_core.data.sequence import positions
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.evaluation import metrics
from gcl_core.evaluation.plots import birds_eye
from gcl_ros.bag import Encounter, pair_encounters, write_bag
from gcl_ros.session import Row, through_node

WORLD, KIND = 11, 'mixed'  # a street that training never sees
DISTANCES = (45, 40, 36, 32, 28, 24, 20, 16, 12, 8)  # metres
PERIOD = 4.0  # seconds between pairs: two cores at work on everything at once


def encounters() -> list[Encounter]:
    """Two vehicles approach each other and pass."""
    target = SimulatedSequence(WORLD, kind=KIND)
    source = SimulatedSequence(WORLD, kind=KIND, route='oncoming')
    where = positions(source)
    at = len(target) // 2
    apart = np.linalg.norm(where - target.T_world_lidar(at)[:3, 3], axis=1)
    before = int(apart.argmin())
    pairs = [(int(np.abs(apart[:before] - d).argmin()), at) for d in DISTANCES]
    return list(pair_encounters(source, target, pairs, PERIOD))


HEADER = (
    ' distance    estimated x, y, z, yaw           true x, y, z, yaw'
    '                  RTE      RRE   latency'
)


def _pose(T: np.ndarray) -> str:
    x, y, z = T[:3, 3]
    heading = np.rad2deg(se3.yaw(T))
    return f'{x:7.2f} {y:6.2f} {z:5.2f} {heading:7.1f}°'


def format_row(row: Row) -> str:
    """One line of the table."""
    distance = f'{np.linalg.norm(row.T_true[:3, 3]):7.1f} m'
    if row.T_estimated is None:
        return f'{distance}   {"no transform published":29s}  {_pose(row.T_true)}'
    return (
        f'{distance}  {_pose(row.T_estimated)}  {_pose(row.T_true)}  '
        f'{metrics.rte(row.T_estimated, row.T_true):6.2f} m '
        f'{metrics.rre_deg(row.T_estimated, row.T_true):6.2f}° {row.latency:6.1f} s'
    )


def summary(rows: list[Row]) -> tuple[str, bool]:
    """Count what was right, wrong and withheld; true if something was right and nothing wrong."""
    right = sum(metrics.registered(r.T_estimated, r.T_true, metrics.LOOSE) for r in rows)
    strict = sum(metrics.registered(r.T_estimated, r.T_true, metrics.STRICT) for r in rows)
    published = sum(r.T_estimated is not None for r in rows)
    text = (
        f'{len(rows)} pairs: {right} registered (2 m, 5°), {strict} of them strictly '
        f'(0.6 m, 1.5°); {published - right} wrong; {len(rows) - published} withheld'
    )
    return text, right > 0 and published == right


def run(folder: Path) -> int:
    """Run the demo; returns 0 when transforms came out and none was wrong."""
    folder.mkdir(parents=True, exist_ok=True)
    bag = folder / 'bag'
    meetings = encounters()
    if not bag.exists():
        write_bag(bag, meetings)
    print(f'two vehicles meet; bag {bag}, logs in {folder}\n{HEADER}', flush=True)
    rows = through_node(
        bag,
        folder,
        expected=len(meetings),
        on_estimate=lambda row: print(format_row(row), flush=True),
    )
    for row in rows:
        if row.T_estimated is None:
            print(format_row(row))
    text, good = summary(rows)
    print(text)
    _draw(folder / 'demo.png', rows, meetings)
    return 0 if good else 1


def _draw(path: Path, rows: list[Row], meetings: list[Encounter]) -> None:
    """Draw the most distant pair that was registered."""
    for row, meeting in zip(rows, meetings, strict=False):
        if row.T_estimated is not None:
            distance = np.linalg.norm(row.T_true[:3, 3])
            birds_eye(
                path,
                source=meeting.source,
                target=meeting.target,
                T_target_source=row.T_estimated,
                title=f'two oncoming vehicles {distance:.0f} m apart (simulated HDL-64E)',
            )
            print(f'picture: {path}')
            return
