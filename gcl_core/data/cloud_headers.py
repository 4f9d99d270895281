"""Headers of .pcd and .ply, held against the size of the file before memory is taken.

Open3D takes memory for as many points as a header claims before it looks for them, writes words
of over 255 characters past its buffer, and makes up points where a text file is cut off. So it
reads binary data only, behind these checks; numbers in text are read by numpy.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gcl_core.errors import GclError

LONGEST = 65_536  # bytes of a header
WORD = 200  # characters of a word in it
PLY_SIZES = {'char': 1, 'uchar': 1, 'int8': 1, 'uint8': 1} | {
    **dict.fromkeys(('short', 'ushort', 'int16', 'uint16'), 2),
    **dict.fromkeys(('int', 'uint', 'int32', 'uint32', 'float', 'float32'), 4),
    **dict.fromkeys(('double', 'float64'), 8),
}
LZF = 90  # times that compressed data may grow: 264 bytes from 3
FEWEST = 2  # bytes of a number in text: one digit and a space


@dataclass(frozen=True)
class Header:
    """What a file claims.

    Attributes:
        rows: number of points.
        columns: names of the values of a point.
        size: least bytes of a point.
        text: whether the values are text, a line for each point.
        growth: how many times the data may grow when they are decompressed.
        skip: lines of text before the first point.
    """

    rows: int
    columns: tuple[str, ...]
    size: int
    text: bool
    growth: int = 1
    skip: int = 0


def read_header(path: Path) -> tuple[Header, int]:
    """Read the header of a .pcd or .ply file; also return where the data begin.

    Raises:
        GclError: it is not to be understood, or the file is too short for what it claims.
    """
    with path.open('rb') as file:
        head = file.read(LONGEST)
    end = _end_of_header(head, path.suffix)
    if end is None:
        raise GclError(f'{path} has no {path.suffix} header; it is cut off or of another format')
    lines = [line.split() for line in head[:end].decode('ascii', 'replace').splitlines()]
    if any(len(word) > WORD for line in lines for word in line):
        raise GclError(f'{path}: its header has a word of over {WORD} characters; export it anew')
    try:
        header = (_pcd if path.suffix == '.pcd' else _ply)([line for line in lines if line])
    except (ValueError, KeyError, IndexError) as error:
        raise GclError(f'{path}: its header is broken ({error}); export it anew') from None
    left = path.stat().st_size - end
    if header.rows < 0 or header.size <= 0 or header.rows * header.size > left * header.growth:
        raise GclError(
            f'{path} claims {header.rows} points of {header.size} bytes or more, but has {left} '
            'bytes for them; it is cut off, or its header is wrong'
        )
    return header, end


def _end_of_header(head: bytes, suffix: str) -> int | None:
    """Where the data begin; None where the header does not end."""
    at = head.find(b'\nDATA' if suffix == '.pcd' else b'\nend_header')
    end = head.find(b'\n', at + 1)
    return end + 1 if at >= 0 and end >= 0 else None


def _pcd(lines: list[list[str]]) -> Header:
    words = {line[0]: line[1:] for line in lines}
    fields = words['FIELDS']
    sizes = [int(word) for word in words['SIZE']]
    counts = [int(word) for word in words.get('COUNT', ['1'] * len(fields))]
    if not len(sizes) == len(counts) == len(fields):
        raise ValueError('FIELDS, SIZE and COUNT differ')
    if not all(0 < number <= LONGEST for number in sizes + counts):
        raise ValueError('a SIZE or COUNT is out of range')
    grid = int(words['WIDTH'][0]) * int(words['HEIGHT'][0])
    points = int(words['POINTS'][0]) if 'POINTS' in words else grid
    if points != grid:
        raise ValueError(f'POINTS {points} is not WIDTH times HEIGHT, {grid}')
    kind = words['DATA'][0].lower()
    text = kind == 'ascii'
    size = FEWEST * sum(counts) - 1 if text else sum(s * c for s, c in zip(sizes, counts))
    columns = tuple(name for name, count in zip(fields, counts) for _ in range(count))
    return Header(points, columns, size, text, LZF if kind == 'binary_compressed' else 1)


def _ply(lines: list[list[str]]) -> Header:
    text = ['format', 'ascii'] in [line[:2] for line in lines]
    columns: list[str] = []
    rows, size, before, element = 0, 0, 0, ''
    for line in lines:
        if line[0] == 'element':
            element, count = line[1], int(line[2])
            rows = count if element == 'vertex' else rows
            before += count if not columns and element != 'vertex' else 0
        elif line[0] == 'property' and element == 'vertex':
            columns.append(line[-1])
            least = 1 if line[1] == 'list' else PLY_SIZES[line[1]]
            size += FEWEST if text else least
    return Header(rows, tuple(columns), size - text, text, skip=before)
