"""The named pair sets: [b1, b2], KITTI [10,10], LoKITTI and LoNuScenes, random pairs."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Int

from gcl_core.data.distance_pairs import DistanceRule, dense_rule, distance_pairs, fcgf_pairs
from gcl_core.data.joined import JoinedSequence
from gcl_core.data.overlap import LOW, overlap
from gcl_core.data.pair_list import ListedPair, PairList, listed
from gcl_core.data.pairs import draw_pairs
from gcl_core.data.sequence import Sequence, T_target_source, positions
from gcl_core.errors import GclError

Sequences = Mapping[str, Sequence]  # by the short name that a list gives them
LOW_OVERLAP_BINS = ((5, 20), (20, 30), (30, 40), (40, 50))  # metres; paper, appendix
FCGF_LEFT_OUT = ListedPair('08', 15, 58)  # KITTI's GPS is wrong there (FCGF's test set)


def distance_set(sequences: Sequences, low: int, high: int) -> PairList:
    """The paper's test set [b1, b2]: see `gcl_core.data.distance_pairs`."""
    rule = DistanceRule(low, high)
    pairs = _each(sequences, lambda sequence: distance_pairs(positions(sequence), rule))
    name = f'{_kind(sequences)} [{low},{high}]'
    return PairList(name, pairs, (low, high), (f'rule: {rule}', _poses(sequences)))


def fcgf_set(sequences: Sequences) -> PairList:
    """FCGF's 10 m protocol; KITTI 08 to 10 give its 555 pairs."""
    pairs = _each(sequences, lambda sequence: fcgf_pairs(positions(sequence)))
    if _kind(sequences) == 'kitti':
        pairs = tuple(pair for pair in pairs if pair != FCGF_LEFT_OUT)
    return PairList(
        f'{_kind(sequences)} [10,10]', pairs, (10, 10), ('rule: FCGF', _poses(sequences))
    )


def low_overlap_set(
    sequences: Sequences,
    *,
    dense: bool = True,
    keep: Callable[[ListedPair, float], None] = lambda pair, share: None,
) -> PairList:
    """Pairs of which at most 30 % of the source's points are seen by the target.

    The paper takes the pairs of its sets [5,20], [20,30], [30,40], [40,50]. Its public list of 545
    follows from searches every 11 frames instead (`dense`, the default: all published figures are
    on that list). It is in order of distance, then of sequence.

    Args:
        sequences: by short name.
        dense: search every 11 frames; otherwise the paper's sets.
        keep: called with each candidate and its overlap, for progress.
    """
    pairs = []
    for low, high in LOW_OVERLAP_BINS:
        rule = dense_rule(low, high) if dense else DistanceRule(low, high)
        for name, sequence in sequences.items():
            for pair in listed(name, distance_pairs(positions(sequence), rule)):
                share = overlap(
                    source=sequence.scan(pair.source),
                    target=sequence.scan(pair.target),
                    T_target_source=T_target_source(
                        sequence, source=pair.source, target=pair.target
                    ),
                )
                keep(pair, share)
                if share <= LOW:
                    pairs.append(pair)
    rule_note = f'rule: overlap <= {LOW}, {"every 11 frames" if dense else "paper sets"}'
    return PairList(
        f'{_kind(sequences)} low overlap', tuple(pairs), None, (rule_note, _poses(sequences))
    )


def random_set(
    sequences: Sequences, *, per_bin: int, seed: int, between: bool = False
) -> PairList:
    """Random pairs in five distance bins, for short sequences: see `draw_pairs`.

    Args:
        sequences: by short name.
        per_bin: most pairs of a bin and a sequence.
        seed: of the draw.
        between: only pairs between two vehicles, of sequences that join them.

    Raises:
        GclError: pairs between two vehicles are wanted of a sequence of one.
    """

    def draw(sequence: Sequence) -> list[tuple[int, int]]:
        drives = _drives(sequence) if between else None
        pairs = draw_pairs(sequence, per_bin=per_bin, seed=seed, drives=drives)
        return [(p.source, p.target) for p in pairs]

    two = ' between two vehicles' if between else ''
    name = f'{_kind(sequences)} random {per_bin} a bin{two}, seed {seed}'
    return PairList(name, _each(sequences, draw), None, (_poses(sequences),))


def _drives(sequence: Sequence) -> Int[np.ndarray, ' n']:
    if not isinstance(sequence, JoinedSequence):
        raise GclError(
            f'{sequence.name} is one vehicle, and pairs.between wants pairs of two; give '
            'source.meet, or leave pairs.between out'
        )
    return sequence.drives


def _each(
    sequences: Sequences, draw: Callable[[Sequence], list[tuple[int, int]]]
) -> tuple[ListedPair, ...]:
    return tuple(
        pair for name, sequence in sequences.items() for pair in listed(name, draw(sequence))
    )


def _kind(sequences: Sequences) -> str:
    """What the sequences are part of, such as `kitti`."""
    return '+'.join(dict.fromkeys(s.name.split('/')[0] for s in sequences.values()))


def _poses(sequences: Sequences) -> str:
    return 'sequences: ' + ', '.join(s.name for s in sequences.values())
