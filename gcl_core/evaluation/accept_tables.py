"""Tables of what was accepted that must not be, and refused that need not be."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from gcl_core.evaluation import metrics

BINS = (5, 10, 20, 30, 40, 50)  # metres


@dataclass(frozen=True)
class Row:
    """What came of one pair.

    Attributes:
        kind: of pair.
        headings: of the source that were searched: not all where fewer were enough to accept.
        distance: between the sensors, metres; None where no transform is right.
        accepted: by the registrar.
        probability: that it stated.
        right: within 0.6 m and 1.5 degrees.
        near: within 2 m and 5 degrees.
        reason: of a refusal.
    """

    kind: str
    headings: int
    distance: float | None
    accepted: bool
    probability: float
    right: bool
    near: bool
    reason: str


def by_kind(rows: list[Row]) -> list[dict[str, Any]]:
    """Pairs, accepted, wrong ones among them with their interval, of each kind and of all."""
    kinds = sorted({row.kind for row in rows})
    table = []
    for kind in (*kinds, 'all'):
        own = [row for row in rows if kind in (row.kind, 'all')]
        wrong = sum(row.accepted and not row.right for row in own)
        table.append(
            {
                'kind': kind,
                'pairs': len(own),
                'pairs_by_headings': dict(Counter(row.headings for row in own)),
                'accepted': sum(row.accepted for row in own),
                'wrong': wrong,
                'beyond_2m_5deg': sum(row.accepted and not row.near for row in own),
                'wrong_percent': [round(100 * p, 3) for p in metrics.wilson(wrong, len(own))],
            }
        )
    return table


def by_distance(rows: list[Row]) -> list[dict[str, Any]]:
    """Of true pairs: how many are right, and how many of the right ones are refused."""
    table = []
    for low, high in pairwise(BINS):
        own = [r for r in rows if r.kind == 'true' and low <= (r.distance or 0) < high]
        right = [row for row in own if row.right]
        refused = sum(not row.accepted for row in right)
        table.append(
            {
                'metres': [low, high],
                'pairs': len(own),
                'right': len(right),
                'refused': refused,
                'refused_percent': [
                    round(100 * p, 1) for p in metrics.wilson(refused, len(right))
                ],
            }
        )
    return table


def markdown(rows: list[Row]) -> str:
    """Both tables for people."""
    lines = [
        '| kind | pairs | accepted | wrong | beyond 2 m, 5° | wrong, % (95 %) |',
        '|' + '---|' * 6,
    ]
    for r in by_kind(rows):
        low, high = r['wrong_percent']
        lines.append(
            f'| {r["kind"]} | {r["pairs"]} | {r["accepted"]} | {r["wrong"]} '
            f'| {r["beyond_2m_5deg"]} | {low:.2f}–{high:.2f} |'
        )
    lines += [
        '',
        '| true pairs, m | pairs | right | of them refused | % (95 %) |',
        '|' + '---|' * 5,
    ]
    for r in by_distance(rows):
        low, high = r['refused_percent']
        (a, b), refused = r['metres'], r['refused']
        lines.append(
            f'| {a}–{b} | {r["pairs"]} | {r["right"]} | {refused} | {low:.0f}–{high:.0f} |'
        )
    return '\n'.join(lines)
