"""What goes wrong when: drawn from a seed, the same for every process that asks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

Kind = Literal[
    'kill source',  # the publisher is killed and comes back
    'kill target',
    'drop',  # half of the source's messages
    'delay',  # each message of the source by up to a second
    'repeat',  # every message up to three times
    'reorder',  # the source's, within half a second
    'step apart',  # the source's stamps jump by seconds
    'step back',  # the stamps of both jump back
    'garbage',  # malformed clouds between the good ones
    'slow processor',  # others want it too
    'full disk',  # nothing more can be written
]
WARM_UP = 20.0  # seconds before the first fault
LASTS, PAUSE = 8.0, 7.0  # seconds of a fault, and to recover from it


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong.

    Attributes:
        kind: what.
        start: seconds after the run began.
        end: likewise.
        size: drawn in [0, 1): how bad.
    """

    kind: Kind
    start: float
    end: float
    size: float


def schedule(seed: int, seconds: float) -> list[Fault]:
    """Every kind in turn, in an order drawn anew for each round, until the time is up."""
    rng = np.random.default_rng([seed, 1])
    found: list[Fault] = []
    start, kinds = WARM_UP, list(get_args(Kind))
    while True:
        for number in rng.permutation(len(kinds)):
            if start + LASTS + PAUSE > seconds:
                return found
            found.append(Fault(kinds[number], start, start + LASTS, float(rng.random())))
            start += LASTS + PAUSE


def active(faults: list[Fault], now: float) -> Fault | None:
    """What goes wrong now."""
    return next((fault for fault in faults if fault.start <= now < fault.end), None)
