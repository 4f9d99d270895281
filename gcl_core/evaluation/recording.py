"""A pair as a Rerun recording, to look around in: clouds, matches, before and after."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.errors import GclError
from gcl_core.files import check_writable
from gcl_core.types import Correspondences, PointCloud

TARGET, SOURCE, MATCH = (25, 113, 194), (232, 89, 12), (47, 158, 68)


def check_recording(path: Path) -> None:
    """See that a recording can be written: before the work, not after.

    Raises:
        GclError: the package is not installed, the file does not end in `.rrd`, or it cannot be
            written there.
    """
    if find_spec('rerun') is None:
        raise GclError("a recording needs Rerun's package: pip install rerun-sdk")
    if path.suffix.lower() != '.rrd':
        raise GclError(f'recording {path}: unknown format {path.suffix!r}; use .rrd')
    check_writable(path)


def record(
    path: Path,
    *,
    source: PointCloud,
    target: PointCloud,
    T_target_source: Float[np.ndarray, '4 4'] | None,
    matches: Correspondences | None = None,
) -> None:
    """Write a recording in the target's frame, with two steps: as they came, and registered.

    Args:
        path: ends in `.rrd`.
        source: scan.
        target: scan.
        T_target_source: None leaves the second step out.
        matches: in the scans' own frames, joined by lines.

    Raises:
        GclError: the file cannot be written.
    """
    import rerun

    stream = rerun.RecordingStream('gcl')
    try:
        stream.save(path)
    except (OSError, RuntimeError, ValueError) as error:
        raise GclError(f'cannot write recording {path}: {error}') from None
    stream.log('target', rerun.Points3D(target.points, colors=TARGET), static=True)
    for step, T in enumerate((np.eye(4), T_target_source)):
        if T is None:
            continue
        stream.set_time('step', sequence=step)
        moved = se3.transform(T, source.points)
        stream.log('source', rerun.Points3D(moved, colors=SOURCE))
        if matches is not None:
            ends = se3.transform(T, matches.source.double().numpy())
            lines = np.stack([ends, matches.target.double().numpy()], 1)
            stream.log('matches', rerun.LineStrips3D(lines, colors=MATCH))
    stream.flush()
    stream.disconnect()
