"""Training samples over recorded drives: a centre scan and its neighbours, anew each epoch.

Paper, section "Overview of GCL" and appendix "Dataset Preparation": centres every 11 frames, one
neighbour from each of phi segments of [-60 m, 60 m].
"""

from __future__ import annotations

from collections.abc import Sequence as List
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from gcl_core import se3
from gcl_core.data.groups import REACH, segments
from gcl_core.data.sequence import Sequence, positions
from gcl_core.errors import GclError
from gcl_core.types import PointCloud

EVERY = 11  # frames between centres; paper
WINDOW = 600  # frames to either side where neighbours lie; public code: 10 for each of 60 m


@dataclass(frozen=True)
class ScanGroup:
    """Scans that are trained together, as they were recorded.

    Attributes:
        clouds: of the centre first, then of its neighbours, each in its own frame.
        T_centre_scan: pose of each scan in the centre's frame; the first is the identity.
        sequence: name of the drive.
        scans: index of each scan in it.
    """

    clouds: tuple[PointCloud, ...]
    T_centre_scan: Float[np.ndarray, 's 4 4']
    sequence: str
    scans: tuple[int, ...]


class GroupIndex:
    """All centres of some drives; group number `i` depends on the seed and `i` alone.

    One pass over the centres, in a new order with new neighbours, is an epoch; numbers go on
    beyond it without end, so that a run can be resumed at any of them.

    Args:
        sequences: drives with poses.
        phi: neighbours of a centre (paper: 6).
        reach: of the segments to either side, metres (paper: 60).
        window: frames to either side where neighbours lie. It keeps out later visits of the same
            place, of which the poses drift.

    Raises:
        GclError: no frame has all segments filled.
    """

    def __init__(
        self,
        sequences: List[Sequence],
        *,
        phi: int = 6,
        reach: float = REACH,
        window: int = WINDOW,
    ) -> None:
        self._sequences, self._phi, self._reach, self._window = list(sequences), phi, reach, window
        self._positions = [positions(sequence) for sequence in sequences]
        self.centres = [
            (number, centre)
            for number, where in enumerate(self._positions)
            for centre in find_centres(where, phi=phi, reach=reach, window=window)
        ]
        if not self.centres:
            names = ', '.join(sequence.name for sequence in sequences) or 'no sequence'
            raise GclError(
                f'no scan of {names} has a neighbour in each of {phi} segments of '
                f'[-{reach:g} m, {reach:g} m]; take longer drives, a smaller phi or reach'
            )

    def __len__(self) -> int:
        """Number of centres: groups in an epoch."""
        return len(self.centres)

    def scans(
        self, number: int, *, seed: int, distances: tuple[float, float] | None = None
    ) -> tuple[Sequence, tuple[int, ...]]:
        """Choose the scans of group `number`: the centre first, then its neighbours."""
        epoch, place = divmod(number, len(self))
        order = np.random.default_rng([seed, epoch, 11]).permutation(len(self))
        drive, centre = self.centres[order[place]]
        rng = np.random.default_rng([seed, number, 12])
        if distances:
            filled = [between(self._positions[drive], centre, distances, self._window)]
        else:
            filled = segments(
                self._positions[drive],
                centre,
                self._phi,
                reach=self._reach,
                window=self._window,
            )
        return self._sequences[drive], (centre, *(int(rng.choice(part)) for part in filled))

    def group(
        self, number: int, *, seed: int, distances: tuple[float, float] | None = None
    ) -> ScanGroup:
        """Read group `number`.

        Args:
            number: from 0 on, without end.
            seed: of order and neighbours.
            distances: take one neighbour that is so far away, metres, instead of one from each
                segment: the pair-wise baseline.

        Raises:
            GclError: no scan is that far away.
        """
        sequence, scans = self.scans(number, seed=seed, distances=distances)
        T_centre_world = se3.inverse(sequence.T_world_lidar(scans[0]))
        poses = [T_centre_world @ sequence.T_world_lidar(scan) for scan in scans]
        clouds = tuple(sequence.scan(scan) for scan in scans)
        return ScanGroup(clouds, np.stack(poses), sequence.name, scans)


def between(
    where: Float[np.ndarray, 'n 3'], centre: int, distances: tuple[float, float], window: int
) -> Int64[np.ndarray, ' k']:
    """Scans at a distance from a centre scan, metres.

    Raises:
        GclError: there are none.
    """
    first = max(0, centre - window)
    away = np.linalg.norm(where[first : centre + window + 1] - where[centre], axis=1)
    found = first + np.flatnonzero((away >= distances[0]) & (away < distances[1]))
    if len(found) == 0:
        raise GclError(
            f'no scan lies {distances[0]:g} to {distances[1]:g} m from scan {centre}; take a '
            'longer drive or other distances'
        )
    return found


def find_centres(
    where: Float[np.ndarray, 'n 3'],
    *,
    phi: int,
    reach: float = REACH,
    every: int = EVERY,
    window: int = WINDOW,
) -> list[int]:
    """Frames with a neighbour in each of `phi` segments, `every` frames apart or more."""
    centres = []
    frame = 0
    while frame < len(where):
        if all(len(part) for part in segments(where, frame, phi, reach=reach, window=window)):
            centres.append(frame)
            frame += every
        else:
            frame += 1
    return centres
