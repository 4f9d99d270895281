"""Bytes, time and recall of compact scans: `make bench-compact DATA=DIR`.

    python -m gcl_core.bench.compact --data DIR --out bench/compact.json

Simulated scans of every sensor, in worlds that neither training nor calibration nor the priors of
the coder come from, and every recorded drive of `--data` or GCL_REAL_DATA. Beside them Draco
(DracoPy), if it is installed, on the same points: the centres of the same voxels, on a grid of
the same size, at its smallest setting. Recall goes on where it was stopped: `compact_recall`. Run
it when nothing else runs.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gcl_core.bench.compact_recall import recall
from gcl_core.bench.measure import milliseconds
from gcl_core.compact.scan import CompactConfig, decode, encode
from gcl_core.data.formats import open_sequences, sequence_names
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sensors import SENSORS
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import bad_input_exits
from gcl_core.evaluation.benchmark import SourceConfig
from gcl_core.files import write_text
from gcl_core.ops.memory import keep_freed_memory
from gcl_core.progress import progress
from gcl_core.provenance import provenance_for
from gcl_core.to_json import to_json
from gcl_core.types import PointCloud

VOXEL_SIZES = (0.1, 0.2, 0.25, 0.3)  # metres
FIRST_WORLD = 960_000_000
REPEATS = 5  # of each scan; the shortest processor time counts
SMALLEST = 10  # Draco's compression level

Coder = Callable[[np.ndarray, float], int]  # points (n, 3) and the grid's size to bytes


def main(arguments: list[str] | None = None) -> None:
    """Measure, print a table, write the JSON."""
    parser = argparse.ArgumentParser(prog='compact', description=__doc__)
    parser.add_argument('--data', type=Path, default=os.environ.get('GCL_REAL_DATA') or None)
    parser.add_argument('--out', type=Path, default=Path('bench/compact.json'))
    parser.add_argument('--folder', type=Path, default=Path('build/compact'), help='of the runs')
    parser.add_argument('--per-bin', type=int, default=6, help='pairs of each bin; 0: no recall')
    parser.add_argument('--scans', type=int, default=20, help='most of each drive or sensor')
    parser.add_argument('--worlds', type=int, default=4, help='simulated, for each sensor')
    parser.add_argument('--sensors', nargs='*', default=[*SENSORS], choices=[*SENSORS])
    options = parser.parse_args(arguments)
    with bad_input_exits('compact'):
        measure(options)


def measure(options: argparse.Namespace) -> None:
    """Write what came of all sources."""
    here = provenance_for(options.out)
    keep_freed_memory()
    draco = draco_size()
    if draco is None:
        print('Draco left out: pip install DracoPy', file=sys.stderr)
    found = sources(options)
    rows = [row for name, source in found.items() for row in sizes(name, source, options, draco)]
    print(table(rows))
    content: dict[str, Any] = {**here, 'default_voxel_size_m': CompactConfig().voxel_size}
    content |= {'sizes': rows, 'recall': []}
    if options.per_bin:
        for name, source in found.items():
            content['recall'] += recall(name, source, options.per_bin, options.folder, here)
    write_text(options.out, to_json(content, indent=1) + '\n')
    print(f'wrote {options.out}')


def sources(options: argparse.Namespace) -> dict[str, SourceConfig]:
    """Every sensor and every recorded drive by its name in results."""
    worlds = tuple(range(FIRST_WORLD, FIRST_WORLD + options.worlds))
    found = {
        f'simulated {name}': SourceConfig(simulated=worlds, sensors=(name,))
        for name in options.sensors
        if worlds
    }
    for name in sequence_names(options.data) if options.data else ():
        found[f'recorded {name}'] = SourceConfig(data=str(options.data), sequences=(name,))
    return found


def scans(source: SourceConfig, most: int) -> Iterator[PointCloud]:
    """Scans of a source, spread evenly over its drives."""
    drives: list[Sequence] = [
        SimulatedSequence(seed, sensor=source.sensors[0]) for seed in source.simulated
    ] or [*open_sequences(Path(source.data), list(source.sequences)).values()]
    places = [(drive, index) for drive in drives for index in range(len(drive))]
    for row in np.linspace(0, len(places) - 1, min(most, len(places))).round().astype(int):
        drive, index = places[row]
        yield drive.scan(index)


def sizes(
    name: str, source: SourceConfig, options: argparse.Namespace, draco: Coder | None
) -> list[dict[str, Any]]:
    """Bytes and milliseconds at each voxel size."""
    found: dict[float, list[dict[str, float]]] = {size: [] for size in VOXEL_SIZES}
    for cloud in progress(scans(source, options.scans), unit='scan', desc=name):
        for voxel_size in VOXEL_SIZES:
            found[voxel_size].append(one(cloud, voxel_size, draco))
    return [row(name, size, scans_) for size, scans_ in found.items()]


def one(cloud: PointCloud, voxel_size: float, draco: Coder | None) -> dict[str, float]:
    """What a scan comes to."""
    config = CompactConfig(voxel_size=voxel_size)
    data = encode(cloud, config)
    centres = decode(data).points
    with one_core():
        encoding = milliseconds(lambda: encode(cloud, config), REPEATS, time.process_time)
        decoding = milliseconds(lambda: decode(data), REPEATS, time.process_time)
    return {
        'points': len(cloud),
        'voxels': len(centres),
        'bytes': len(data),
        'encode_ms': encoding,
        'decode_ms': decoding,
        'draco_bytes': draco(centres, voxel_size) if draco else np.nan,
    }


@contextmanager
def one_core() -> Iterator[None]:
    """Compute with one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def row(name: str, voxel_size: float, measured: list[dict[str, float]]) -> dict[str, Any]:
    """One source at one voxel size: median and 95th percentile over its scans."""
    found: dict[str, Any] = {'source': name, 'voxel_size_m': voxel_size, 'scans': len(measured)}
    for key in measured[0]:
        values = [scan[key] for scan in measured]
        digits = 2 if key.endswith('_ms') else 0
        found[f'{key}_median'] = round(float(np.median(values)), digits)
        if key not in ('points', 'voxels'):
            found[f'{key}_p95'] = round(float(np.percentile(values, 95)), digits)
    return found


def draco_size() -> Coder | None:
    """What Draco makes of points on a grid; None where it is not installed."""
    try:
        import DracoPy  # type: ignore[import-not-found]
    except ImportError:
        return None

    def size(points: np.ndarray, voxel_size: float) -> int:
        origin = points.min(0)
        cells = round(float((points - origin).max()) / voxel_size)
        bits = max(1, cells.bit_length())
        data = DracoPy.encode(
            points,
            quantization_bits=bits,
            quantization_range=(2**bits - 1) * voxel_size,  # a step of one voxel
            quantization_origin=origin,
            compression_level=SMALLEST,
        )
        back = DracoPy.decode(data).points
        assert len(np.unique(np.round((back - origin) / voxel_size), axis=0)) == len(points)
        return len(data)

    return size


def table(rows: list[dict[str, Any]]) -> str:
    """As Markdown."""
    lines = [
        '| source | voxel, m | scans | bytes, median | p95 | Draco | encode, ms | decode, ms |'
    ]
    lines.append('|---|---|---|---|---|---|---|---|')
    for r in rows:
        draco = r['draco_bytes_median']
        cells = [r['source'], r['voxel_size_m'], r['scans'], f'{r["bytes_median"]:,.0f}']
        cells += [f'{r["bytes_p95"]:,.0f}', '' if np.isnan(draco) else f'{draco:,.0f}']
        cells += [f'{r["encode_ms_median"]:.1f}', f'{r["decode_ms_median"]:.1f}']
        lines.append(f'| {" | ".join(map(str, cells))} |')
    return '\n'.join(lines)


if __name__ == '__main__':
    main()
