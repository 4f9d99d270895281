"""How a .bin lays out its points: it has no header, so its numbers have to tell.

The right number of columns is the one that parts the values best: x, y, z and intensity spread
differently, and a wrong number mixes them. What is measured is the information, in nats, that a
value's place modulo the number of columns gives about the value; it needs no order of the points.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64, UInt8

from gcl_core.errors import GclError

KINDS = {'float64': '<f8', 'float32': '<f4'}  # tried in this order: none passes for float64
MOST = 16  # columns: PCL's widest point of floats has 12
REMEDY = 'say it by --columns 5, or --columns 4xfloat64 (in Python: layout)'
SAMPLE, CHUNKS = 24_000, 6  # values looked at, and the runs of them, spread over the file
FEWEST = 120  # values that tell something: 30 points of KITTI
BINS = 64  # of values, equally full
LEAST = 0.05  # nats that columns must tell
CONTENDER = 0.8  # of the best's information, which leaves two numbers of columns possible
ALIKE, UNLIKE = 0.4, 0.5  # bits between halves of a row: one point twice, or one point
SANE = (1e-4, 1e6)  # magnitudes of metres, intensities and rings; zero besides
LEAST_SANE = 0.6  # share of sane values; times in nanoseconds may lie among them
SANE_AXES = 0.9  # the same of x, of y and of z


@dataclass(frozen=True)
class BinLayout:
    """Rows of a .bin.

    Attributes:
        columns: numbers of a point; the first three are x, y, z.
        kind: `float32` or `float64`.
    """

    columns: int
    kind: str = 'float32'

    def __str__(self) -> str:
        return f'{self.columns} columns of {self.kind}'

    @property
    def row(self) -> int:
        """Bytes of a point."""
        return self.columns * np.dtype(KINDS[self.kind]).itemsize


KITTI, NUSCENES = BinLayout(4), BinLayout(5)


def told_layout(text: str | None) -> BinLayout | None:
    """A layout from `5` or `4xfloat64`; None from nothing.

    Raises:
        GclError: it is neither.
    """
    if not text:
        return None
    match = re.fullmatch(r'(\d{1,4})(?:x(float32|float64))?', text)
    if not match or int(match[1]) < 3:
        raise GclError(f'columns {text!r}: give 3 or more, such as 5, or 4xfloat64')
    return BinLayout(int(match[1]), match[2] or 'float32')


def recognised(data: UInt8[np.ndarray, ' bytes'], name: str) -> BinLayout:
    """See the layout of a file from its numbers.

    Args:
        data: all of the file.
        name: of the file, for errors.

    Raises:
        GclError: the numbers fit no layout, or several, or the file is cut off.
    """
    if len(data) < 4 * FEWEST:
        return _fitting(KITTI, data, name)
    samples = {kind: _sample(_values(data, kind)) for kind in KINDS}
    metres = {kind: sample for kind, sample in samples.items() if _sane(sample[0]) >= LEAST_SANE}
    if not metres:
        raise GclError(
            f'{name} holds no metres as float32 or float64; is it a cloud? If so, {REMEDY}'
        )
    for kind, (values, places) in metres.items():
        columns = _columns(values, places)
        if columns and _are_points([values[places % columns == axis] for axis in range(3)]):
            return _fitting(BinLayout(columns, kind), data, name)
    raise GclError(f'{name} does not show how many columns of which kind it has; {REMEDY}')


def _fitting(layout: BinLayout, data: UInt8[np.ndarray, ' bytes'], name: str) -> BinLayout:
    if len(data) % layout.row:
        raise GclError(
            f'{name} has {len(data)} bytes, not a multiple of {layout.row} ({layout}): '
            f'it is cut off or of another layout; if so, {REMEDY}'
        )
    return layout


def rows(
    data: UInt8[np.ndarray, ' bytes'], layout: BinLayout, name: str
) -> Float[np.ndarray, 'n columns']:
    """Points of a file, a row each.

    Raises:
        GclError: the last row is cut off.
    """
    _fitting(layout, data, name)
    return data.view(KINDS[layout.kind]).reshape(-1, layout.columns)


def _values(data: UInt8[np.ndarray, ' bytes'], kind: str) -> Float[np.ndarray, ' n']:
    size = np.dtype(KINDS[kind]).itemsize
    return data[: len(data) // size * size].view(KINDS[kind])


def _sample(
    values: Float[np.ndarray, ' n'],
) -> tuple[Float[np.ndarray, ' k'], Int64[np.ndarray, ' k']]:
    """Some of the values, and where each stands in the file."""
    if len(values) <= SAMPLE:
        places = np.arange(len(values))
    else:
        starts = np.linspace(0, len(values) - SAMPLE // CHUNKS, CHUNKS).astype(np.int64)
        places = (starts[:, None] + np.arange(SAMPLE // CHUNKS)).ravel()
    return values[places], places


def _sane(values: Float[np.ndarray, ' k']) -> float:
    """Share of the finite values that are zero or of a size that clouds have."""
    sizes = np.abs(values[np.isfinite(values)])
    sane = (sizes == 0) | ((sizes >= SANE[0]) & (sizes <= SANE[1]))
    return float(sane.sum() / max(len(sizes), 1))


def _are_points(xyz: list[Float[np.ndarray, ' k']]) -> bool:
    """Whether columns may be x, y, z: halves of float64 are of any magnitude, or all zero."""
    return min(map(_sane, xyz)) >= SANE_AXES and len(np.unique(xyz[0])) > 1


def _columns(values: Float[np.ndarray, ' k'], places: Int64[np.ndarray, ' k']) -> int | None:
    """Number of columns; None where no number stands out."""
    codes = _codes(values)
    tables = {s: _counts(codes, places % s, s) for s in range(3, MOST + 1)}
    told = {s: _information(table) for s, table in tables.items()}
    most = max(told, key=lambda s: told[s])
    best = _single(tables, most) if told[most] >= LEAST else None
    if best is None:
        return None
    rivals = [s for s in told if s % best and best % s]
    return None if any(told[s] > CONTENDER * told[best] for s in rivals) else best


def _single(tables: dict[int, Int64[np.ndarray, 'columns bins']], columns: int) -> int | None:
    """Columns of one point where so many may hold several; None where that is not clear."""
    apart = {
        s: _difference(tables[columns], s) for s in tables if s < columns and columns % s == 0
    }
    alike = [s for s in apart if apart[s] < ALIKE]
    if alike:
        return _single(tables, max(alike))
    return None if any(found < UNLIKE for found in apart.values()) else columns


def _codes(values: Float[np.ndarray, ' k']) -> Int64[np.ndarray, ' k']:
    """Number of the bin of each value; those that are not finite have the last."""
    finite = np.isfinite(values)
    bins = int(np.clip(len(values) // 40, 4, BINS))
    edges = np.unique(np.quantile(values[finite], np.linspace(0, 1, bins + 1)[1:-1]))
    return np.where(finite, np.searchsorted(edges, values, side='right'), bins)


def _counts(
    codes: Int64[np.ndarray, ' k'], column: Int64[np.ndarray, ' k'], columns: int
) -> Int64[np.ndarray, 'columns bins']:
    bins = int(codes.max()) + 1
    flat = np.bincount(column * bins + codes, minlength=columns * bins)
    return flat.reshape(columns, bins)


def _entropy(counts: np.ndarray) -> Float[np.ndarray, ' ...']:
    """Of each row of counts, nats."""
    shares = counts / np.maximum(counts.sum(-1, keepdims=True), 1)
    return -np.where(shares > 0, shares * np.log(np.maximum(shares, 1e-300)), 0.0).sum(-1)


def _information(table: Int64[np.ndarray, 'columns bins']) -> float:
    """What the column tells of a value, less what chance does (Miller and Madow)."""
    weights = table.sum(1) / table.sum()
    found = float(_entropy(table.sum(0)) - weights @ _entropy(table))
    return found - (len(table) - 1) * (table.shape[1] - 1) / (2 * table.sum())


def _difference(table: Int64[np.ndarray, 'columns bins'], part: int) -> float:
    """How unlike the parts of a row are, bits: 0 for the same point again, 1 for other values."""
    shares = (table / np.maximum(table.sum(1, keepdims=True), 1)).reshape(-1, part, table.shape[1])
    mixed = _entropy(shares.mean(0)) - _entropy(shares).mean(0)
    return float(mixed.mean() / np.log(len(shares)))
