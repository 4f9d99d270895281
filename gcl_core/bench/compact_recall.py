"""Recall by distance of one source's scans as they are and as another vehicle receives them.

The same random pairs both times, to 80 m, each source turned by the same random heading. Every
prediction stays in the folder of its run, so that a second call goes on where the first was
stopped.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from gcl_core.compact.scan import CompactConfig
from gcl_core.data.pair_list import ListedPair, PairList, listed, write_pair_list
from gcl_core.data.pairs import BINS, draw_pairs
from gcl_core.data.sequence import Sequence
from gcl_core.evaluation.benchmark import BenchmarkConfig, Ours, PairsConfig, SourceConfig
from gcl_core.evaluation.plan import open_source
from gcl_core.evaluation.runner import Run
from gcl_core.evaluation.score import score

FARTHER = (*BINS, (50, 60), (60, 70), (70, 80))  # metres; the registrar's max_distance ends them


def recall(
    name: str, source: SourceConfig, per_bin: int, folder: Path, provenance: dict[str, Any]
) -> list[dict[str, Any]]:
    """Register a source's pairs raw and compact; a row for each bin, method and kind of scans.

    Args:
        name: of the source in results.
        source: raw.
        per_bin: most pairs of a bin and a drive.
        folder: for the runs of all sources.
        provenance: of a run that begins here.
    """
    place = folder / name.replace(' ', '_')
    pairs = place / f'pairs_{per_bin}.txt'
    drawn = draw(name, open_source(BenchmarkConfig(source=source)), per_bin)
    if not drawn.pairs:
        return []
    pairs.parent.mkdir(parents=True, exist_ok=True)
    write_pair_list(pairs, drawn)
    rows = []
    for kind, voxel_size in (('raw', 0.0), ('compact', CompactConfig().voxel_size)):
        config = BenchmarkConfig(
            source=replace(source, compact=voxel_size),
            pairs=(PairsConfig(kind='list', file=str(pairs), name=name),),
            random_yaw=True,
            overlap=False,
            methods=(Ours(give=('accepted', 'best')),),
        )
        run = Run(config, place / f'{kind}_{per_bin}', provenance=provenance)
        commit = run.provenance['commit']
        if commit != provenance['commit']:
            said = f'{run.folder} goes on from commit {commit}'
            print(f'{said}; remove it to measure this one alone', file=sys.stderr)
        for row in score(run.predict()):
            rows.append({'scans': kind, 'commit': commit, **asdict(row)})
    return rows


def draw(name: str, drives: dict[str, Sequence], per_bin: int) -> PairList:
    """Random pairs of each drive."""
    found: list[ListedPair] = []
    for drive, sequence in drives.items():
        pairs = draw_pairs(sequence, per_bin=per_bin, bins=FARTHER)
        found += listed(drive, [(pair.source, pair.target) for pair in pairs])
    return PairList(name, tuple(found))
