"""Pairs that must not be accepted, and some that should: views made once and paired many times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from jaxtyping import Float

from gcl_core import se3
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.kinds import KINDS
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.evaluation.barren import BarrenSequence
from gcl_core.evaluation.encounters import Seen, see
from gcl_core.evaluation.repeated import RepeatedSequence
from gcl_core.registrar import Registrar
from gcl_core.view import View

FIRST_WORLD = 800_000_000  # neither training nor calibration takes these
WORLDS = 6  # of one kind of place in a group
MIRROR = np.diag([1.0, -1.0, 1.0])
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0])
PITCHED = se3.from_xyz_rpy(pitch=np.pi / 2)[:3, :3]


@dataclass(frozen=True)
class Case:
    """A pair and what is known of it.

    Attributes:
        kind: what is difficult about it; `true` where nothing is.
        source: view.
        target: view.
        T_true: None where no transform is right.
    """

    kind: str
    source: View
    target: View
    T_true: Float[np.ndarray, '4 4'] | None


def between(kind: str, source: Seen, target: Seen) -> Case:
    """A pair of one world."""
    T_true = se3.inverse(target.T_world_lidar) @ source.T_world_lidar
    return Case(kind, source.view, target.view, T_true)


def group(registrar: Registrar, number: int, sensor: str = 'hdl64e') -> Iterator[Case]:
    """404 pairs among the scans of six streets of one kind and four special places.

    Args:
        registrar: describes; the headings of the vehicles are such that it may find what is there.
        number: of the group; everything follows from it.
        sensor: on all vehicles.
    """
    rng = np.random.default_rng([number, 12])
    seeds = FIRST_WORLD + 100 * number + np.arange(WORLDS)
    kind = list(KINDS)[number % len(KINDS)]
    streets = []
    for seed in seeds:
        streets.append(Street(registrar, int(seed), kind, sensor, rng))
        yield from streets[-1].cases()
    for special in (
        repeated(registrar, int(seeds[0]), sensor, rng),
        repeated(registrar, int(seeds[1]), sensor, rng),
        barren(registrar, int(seeds[2]), 'tunnel', sensor, rng),
        barren(registrar, int(seeds[3]), 'field', sensor, rng),
    ):
        cases = list(special)
        yield from cases
        stranger = streets[int(rng.integers(WORLDS))].sources
        yield from (Case('unrelated', s.view, cases[0].target, None) for s in stranger)
    for one, other in permutations(streets, 2):
        yield from (
            Case('unrelated, one kind of place', s.view, t.view, None)
            for s in one.sources
            for t in other.targets
        )
    yield from (street.still() for street in streets)


class Street:
    """Scans of one simulated street.

    Attributes:
        targets: one near the middle, one at an end.
        sources: three 5 to 50 m from the first target, one at the other end, out of sight of the
            second.
    """

    def __init__(
        self, registrar: Registrar, seed: int, kind: str, sensor: str, rng: np.random.Generator
    ) -> None:
        self._registrar, self._rng = registrar, rng
        self._drive = SimulatedSequence(seed, kind=kind, sensor=sensor)
        self._yaw = float(rng.uniform(-np.pi, np.pi))
        self._middle = len(self._drive) // 2 + int(rng.integers(-8, 8))
        bins = rng.permutation([5, 10, 20, 30, 40])[:3]
        away = [float(rng.uniform(low, min(2 * low, low + 10))) for low in bins]
        self._near = [self._middle + round(d * rng.choice([-1, 1])) for d in away]
        self.targets = [self._see(i, headings=1) for i in (self._middle, 2)]
        self.sources = [self._see(i) for i in (*self._near, len(self._drive) - 3)]

    def _see(
        self, index: int, *, headings: int | None = None, change: np.ndarray | None = None
    ) -> Seen:
        return see(
            self._registrar,
            self._drive,
            index,
            self._rng,
            headings=headings or self._registrar.config.headings,
            yaw=self._yaw,
            change=change,
        )

    def cases(self) -> Iterator[Case]:
        """Pairs within the street."""
        target = self.targets[0]
        yield from (between('true', source, target) for source in self.sources[:3])
        yield between('out of sight, replayed', self.sources[3], self.targets[1])
        for index in (self._middle, *self._near[:2]):
            mirrored = self._see(index, change=MIRROR)
            yield Case('mirrored', mirrored.view, target.view, None)
            factor = float(self._rng.choice([0.8, 0.9, 1.1, 1.25]))
            scaled = self._see(index, change=factor * np.eye(3))
            yield Case('scaled', scaled.view, target.view, None)
        yield between('upside down', self._see(self._near[0], change=UPSIDE_DOWN), target)
        yield between('pitched by 90 degrees', self._see(self._near[0], change=PITCHED), target)
        yield twice(self._registrar, self._drive, self._middle)

    def still(self) -> Case:
        """A sensor that has not moved: its vehicle's tilt and heading alone differ."""
        return between('static sensor', self._see(self._middle), self.targets[0])


def twice(registrar: Registrar, drive: Sequence, index: int) -> Case:
    """One cloud as two vehicles' clouds: the identity is right."""
    cloud = drive.scan(index)
    return Case('one cloud twice', registrar.view(cloud), registrar.view(cloud), np.eye(4))


def repeated(
    registrar: Registrar, seed: int, sensor: str, rng: np.random.Generator
) -> Iterator[Case]:
    """A street of one house: pairs along it, and with the parallel street."""
    drive = RepeatedSequence(seed, sensor=sensor)
    half, headings = len(drive) // 2, registrar.config.headings
    yaw = float(rng.uniform(-np.pi, np.pi))
    middles = half // 2 + rng.integers(-10, 10, 3)
    targets = [see(registrar, drive, int(i), rng, yaw=yaw) for i in middles]
    along = half // 2 + rng.uniform(5, 50, 4) * rng.choice([-1, 1], 4)
    for place, kind in ((along, 'repeated facades'), (along + half, 'parallel street')):
        for index in place.astype(int).tolist():
            source = see(registrar, drive, index, rng, headings=headings, yaw=yaw)
            yield from (between(kind, source, target) for target in targets)


def barren(
    registrar: Registrar, seed: int, kind: str, sensor: str, rng: np.random.Generator
) -> Iterator[Case]:
    """Pairs 5 to 50 m apart in a tunnel or on an empty field."""
    drive = BarrenSequence(seed, kind, sensor=sensor)
    yaw = float(rng.uniform(-np.pi, np.pi))
    middle, headings = len(drive) // 2, registrar.config.headings
    targets = [see(registrar, drive, i, rng, yaw=yaw) for i in (middle, middle + 7)]
    for away in rng.uniform(5, 50, 4) * rng.choice([-1, 1], 4):
        source = see(registrar, drive, int(middle + away), rng, headings=headings, yaw=yaw)
        yield from (between(kind, source, target) for target in targets)
