"""Feature-match recall on ETH: how many of its published pairs match well enough (paper, table
"Generalization test from KITTI to ETH").
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from gcl_core.data.eth import EthSequence
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError
from gcl_core.evaluation.compare import PAPER_MATCHES
from gcl_core.evaluation.feature_metrics import TAU2, feature_match_recall, inlier_ratio
from gcl_core.evaluation.figures.result import FigureResult, Row
from gcl_core.evaluation.metrics import wilson
from gcl_core.matching.match import match
from gcl_core.registrar import Registrar
from gcl_core.types import Features

TAU1 = 0.1  # metres between the points of a right match (paper)


def eth_recall(registrar: Registrar, sequences: Mapping[str, Sequence]) -> FigureResult:
    """Score every pair that `gt.log` links; one row a scene, and their mean.

    Matches are those of the paper's registrations, one-way from 5,000 random key points; the paper
    does not say which ones its recall counts. A scan is described at one heading, that of its
    street where the network wants it so.

    Args:
        registrar: whose network describes.
        sequences: scenes of ETH.

    Raises:
        GclError: a sequence is none of ETH.
    """
    rows = [_scene(registrar, name, sequence) for name, sequence in sequences.items()]
    mean = float(np.mean([row['fmr_percent'] for row in rows]))
    pairs = sum(row['pairs'] for row in rows)
    rows.append({'scene': 'mean', 'pairs': pairs, 'fmr_percent': mean})
    size = registrar.model.config.voxel_size
    caption = f'Feature-match recall at {TAU1:g} m and {100 * TAU2:g} %, voxels of {size:g} m.'
    return FigureResult('eth_recall', caption, '', rows, 'table generalize_eth.')


def _scene(registrar: Registrar, name: str, sequence: Sequence) -> Row:
    if not isinstance(sequence, EthSequence):
        raise GclError(f'{sequence.name} is no scene of ETH; give --data ETH_DIR')

    @lru_cache(maxsize=8)
    def described(index: int) -> Features:
        cloud = sequence.scan(index)
        return registrar.model.describe_facing(cloud, registrar.model.facing(cloud))

    ratios = []
    for (target, source), T in sorted(sequence.links.items()):
        matches = match(source=described(source), target=described(target), config=PAPER_MATCHES)
        ratios.append(inlier_ratio(matches, T, TAU1))
    good, pairs = feature_match_recall(ratios)
    low, high = wilson(good, pairs)
    return {
        'scene': name,
        'pairs': pairs,
        'fmr_percent': 100 * good / pairs,
        'interval_percent': f'{100 * low:.0f}–{100 * high:.0f}',
        'mean_inlier_percent': 100 * float(np.mean(ratios)),
    }
