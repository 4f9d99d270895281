"""Pair lists: small readable files, each with a hash of what it lists.

    # GCL pair list: kitti [20,30]
    # sha256: 1f0c…
    # distance_m: 20 30
    # sequence source target
    08 150 185

Every result names its list and the hash, so that two results on the same pairs can be told from
two that only sound alike. Lines that begin with `#` are notes, but for these four; a list without
a hash, such as the 545 LoKITTI pairs of the public code (`sequence frame_a frame_b`), reads too.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcl_core.data.pairs import BINS, Pair
from gcl_core.data.sequence import Sequence, T_target_source
from gcl_core.errors import GclError, reason_of
from gcl_core.files import write_text


@dataclass(frozen=True)
class ListedPair:
    """One line of a list.

    Attributes:
        sequence: short name (`08`).
        source: scan index.
        target: scan index.
    """

    sequence: str
    source: int
    target: int


@dataclass(frozen=True)
class PairList:
    """Pairs of one or more sequences.

    Attributes:
        name: what the list is called in results, such as `kitti [20,30]`.
        pairs: in order.
        distance: b1 and b2 of a [b1, b2] set, metres; None for a list of many distances.
        notes: how it was made.
    """

    name: str
    pairs: tuple[ListedPair, ...]
    distance: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()

    @property
    def sha256(self) -> str:
        """Hash of the pairs and their order, hexadecimal; name and notes do not count."""
        return hashlib.sha256('\n'.join(_lines(self.pairs)).encode()).hexdigest()

    @property
    def label(self) -> str:
        """Name, size and hash, as results print them."""
        return f'{self.name}, {len(self.pairs)} pairs, sha256 {self.sha256[:12]}'

    @property
    def sequences(self) -> tuple[str, ...]:
        """Sequences in order of appearance."""
        return tuple(dict.fromkeys(pair.sequence for pair in self.pairs))

    def of(self, name: str, sequence: Sequence) -> list[Pair]:
        """Pairs of one sequence, with their true distance.

        Args:
            name: as the list has it.
            sequence: its scans.

        Raises:
            GclError: the list names a scan that the sequence does not have.
        """
        found = []
        for pair in self.pairs:
            if pair.sequence != name:
                continue
            last = max(pair.source, pair.target)
            if last >= len(sequence):
                raise GclError(
                    f'{self.name} lists scan {last} of {name}, but {sequence.name} has '
                    f'{len(sequence)} scans; is it the sequence that the list was made for?'
                )
            T = T_target_source(sequence, source=pair.source, target=pair.target)
            apart = float(np.linalg.norm(T[:3, 3]))
            found.append(Pair(pair.source, pair.target, apart, self.distance or bin_of(apart)))
        return found


def bin_of(distance: float) -> tuple[int, int]:
    """The bin of `BINS` that a distance falls into; beyond them, its ten metres."""
    tens = 10 * int(distance // 10)
    return next((b for b in BINS if b[0] <= distance < b[1]), (tens, tens + 10))


def listed(name: str, pairs: Iterable[tuple[int, int]]) -> tuple[ListedPair, ...]:
    """Pairs of scans of one sequence as lines of a list.

    Raises:
        GclError: the name holds white space.
    """
    if not name or len(name.split()) != 1:
        raise GclError(f'sequence name {name!r} must be one word to be listed')
    return tuple(ListedPair(name, source, target) for source, target in pairs)


def write_pair_list(path: Path, pairs: PairList) -> None:
    """Write a list.

    Raises:
        GclError: the file cannot be written.
    """
    header = [f'GCL pair list: {pairs.name}', f'sha256: {pairs.sha256}']
    if pairs.distance:
        header.append(f'distance_m: {pairs.distance[0]} {pairs.distance[1]}')
    header += [*pairs.notes, 'sequence source target']
    lines = [f'# {line}' for line in header] + _lines(pairs.pairs)
    write_text(path, '\n'.join(lines) + '\n')


def read_pair_list(path: Path) -> PairList:
    """Read a list; without a hash, a sequence of one digit gets KITTI's two.

    Raises:
        GclError: missing, malformed, or not what its hash says.
    """
    try:
        lines = [line.strip() for line in path.read_text().splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise GclError(
            f'cannot read pair list {path}: {reason_of(error)}; write one with gcl pairs'
        ) from None
    notes = [line[1:].strip() for line in lines if line.startswith('#')]
    header = dict(note.split(': ', 1) for note in notes if ': ' in note)
    digits = 0 if 'sha256' in header else 2
    pairs = tuple(
        _parse(line, digits, f'{path}, line {number}')
        for number, line in enumerate(lines, 1)
        if line and not line.startswith('#')
    )
    if not pairs:
        raise GclError(f'{path} lists no pair; expected lines of `sequence source target`')
    bounds = header.get('distance_m')
    known = ('GCL pair list', 'sha256', 'distance_m')
    result = PairList(
        name=header.get('GCL pair list', path.stem),
        pairs=pairs,
        distance=_bounds(bounds, path) if bounds else None,
        notes=tuple(
            n for n in notes if n.split(': ')[0] not in known and n != 'sequence source target'
        ),
    )
    if 'sha256' in header and header['sha256'] != result.sha256:
        raise GclError(
            f'{path}: its pairs have the sha256 {result.sha256}, not {header["sha256"]}: '
            'they were changed. Remove that line if this was intended'
        )
    return result


def _lines(pairs: Iterable[ListedPair]) -> list[str]:
    return [f'{pair.sequence} {pair.source} {pair.target}' for pair in pairs]


def _parse(line: str, digits: int, where: str) -> ListedPair:
    words = line.split()
    if len(words) != 3 or not (words[1].isdecimal() and words[2].isdecimal()):
        raise GclError(f'{where}: expected `sequence source target`, got {line!r}')
    name = words[0].zfill(digits) if words[0].isdecimal() else words[0]
    return ListedPair(name, int(words[1]), int(words[2]))


def _bounds(text: str, path: Path) -> tuple[int, int]:
    try:
        low, high = (int(word) for word in text.split())
    except ValueError:
        raise GclError(f'{path}: distance_m is {text!r}, expected two whole numbers') from None
    return low, high
