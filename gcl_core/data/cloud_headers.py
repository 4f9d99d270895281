"""Headers of .pcd and .ply, held against the size of the file before memory is taken."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcl_core.errors import GclError

LONGEST = 65_536  # bytes of a header
WORD = 200  # characters of a word in it
# PCD's TYPE and SIZE, and PLY's names of both.
PCD_TYPES = {f'{kind}{size}': f'{kind.lower()}{size}' for kind in 'IU' for size in (1, 2, 4, 8)}
PCD_TYPES |= {'F4': 'f4', 'F8': 'f8'}
PLY_TYPES = {'char': 'i1', 'uchar': 'u1', 'short': 'i2', 'ushort': 'u2', 'int': 'i4', 'uint': 'u4'}
PLY_TYPES |= {f'int{8 * size}': f'i{size}' for size in (1, 2, 4, 8)}
PLY_TYPES |= {f'uint{8 * size}': f'u{size}' for size in (1, 2, 4, 8)}
PLY_TYPES |= {'float': 'f4', 'float32': 'f4', 'double': 'f8', 'float64': 'f8'}
PLY_ORDERS = {'ascii': '', 'binary_little_endian': '<', 'binary_big_endian': '>'}
LZF = 90  # times that compressed data may grow: 264 bytes from 3
FEWEST = 2  # bytes of a number in text: one digit and a space
LIST = 'V0'  # stands for a list, whose size is told row by row
PADDING = '_'  # PCL's name for bytes between fields


@dataclass(frozen=True)
class Field:
    """A value of a point.

    Attributes:
        name: not its own where it is padding.
        kind: of numpy, with its byte order; of another field than x, y, z it may be raw bytes.
        count: how many numbers.
    """

    name: str
    kind: str
    count: int = 1

    @property
    def size(self) -> int:
        """Bytes."""
        return np.dtype(self.kind).itemsize * self.count


@dataclass(frozen=True)
class Header:
    """What a file claims.

    Attributes:
        rows: number of points.
        fields: values of a point, in their order.
        data: `ascii`, `binary`, or `binary_compressed`: each field of all points in turn, by LZF.
        skip: lines of text, or bytes, before the first point.
    """

    rows: int
    fields: tuple[Field, ...]
    data: str
    skip: int = 0

    @property
    def least(self) -> int:
        """Fewest bytes that a point takes in the file, unless it is compressed."""
        if self.data == 'ascii':
            return FEWEST * sum(field.count for field in self.fields) - 1
        return sum(field.size for field in self.fields)

    def column(self, name: str) -> int:
        """Where a field's first number stands in a line of text."""
        at = self.names.index(name)
        return sum(field.count for field in self.fields[:at])

    @property
    def names(self) -> list[str]:
        """Of all fields."""
        return [field.name for field in self.fields]

    @property
    def xyz(self) -> np.dtype[np.void]:
        """Type of a whole point, of which only x, y and z are looked at."""
        places = [self.names.index(axis) for axis in 'xyz']
        return np.dtype(
            {
                'names': list('xyz'),
                'formats': [self.fields[at].kind for at in places],
                'offsets': [sum(f.size for f in self.fields[:at]) for at in places],
                'itemsize': sum(field.size for field in self.fields),
            }
        )


def read_header(path: Path) -> tuple[Header, int]:
    """Read the header of a .pcd or .ply file; also return where the data begin.

    Raises:
        GclError: it is not to be understood, it has no x, y, z, or the file is too short for what
            it claims.
    """
    suffix = path.suffix.lower()
    with path.open('rb') as file:
        head = file.read(LONGEST)
    end = _end_of_header(head, suffix)
    if end is None:
        raise GclError(f'{path} has no {suffix} header; it is cut off or of another format')
    lines = [line.split() for line in head[:end].decode('ascii', 'replace').splitlines()]
    if any(len(word) > WORD for line in lines for word in line):
        raise GclError(f'{path}: its header has a word of over {WORD} characters; export it anew')
    try:
        header = (_pcd if suffix == '.pcd' else _ply)([line for line in lines if line])
    except KeyError as error:
        raise GclError(f'{path}: its header lacks {error.args[0]}; export it anew') from None
    except (ValueError, IndexError) as error:
        raise GclError(f'{path}: its header is broken ({error}); export it anew') from None
    _check(path, header, path.stat().st_size - end)
    return header, end


def _end_of_header(head: bytes, suffix: str) -> int | None:
    """Where the data begin; None where the header does not end."""
    at = head.find(b'\nDATA' if suffix == '.pcd' else b'\nend_header')
    end = head.find(b'\n', at + 1)
    return end + 1 if at >= 0 and end >= 0 else None


def _check(path: Path, header: Header, left: int) -> None:
    """See that there are x, y, z once each, and bytes for what is claimed."""
    names = header.names
    missing = [axis for axis in 'xyz' if axis not in names]
    if missing:
        raise GclError(f'{path} has no {", ".join(missing)}; it has {", ".join(names)}')
    for axis in 'xyz':
        field = header.fields[names.index(axis)]
        if names.count(axis) > 1 or field.count != 1 or np.dtype(field.kind).kind not in 'iuf':
            raise GclError(
                f'{path}: {axis} is not one number of a known type; export it as 4-byte floats'
            )
    room = left * (LZF if header.data == 'binary_compressed' else 1) - header.skip
    if header.rows < 0 or header.skip < 0 or header.rows * header.least > room:
        raise GclError(
            f'{path} claims {header.rows} points of {header.least} bytes or more, but has {left} '
            'bytes for them; it is cut off, or its header is wrong'
        )


def _pcd(lines: list[list[str]]) -> Header:
    words = {line[0]: line[1:] for line in lines}
    names = words['COLUMNS' if 'COLUMNS' in words else 'FIELDS']  # so called up to version 0.5
    sizes, types = [int(word) for word in words['SIZE']], words['TYPE']
    counts = [int(word) for word in words.get('COUNT', ['1'] * len(names))]
    if not len(sizes) == len(types) == len(counts) == len(names):
        raise ValueError('FIELDS, SIZE, TYPE and COUNT differ')
    if not all(0 < number <= LONGEST for number in sizes + counts):
        raise ValueError('a SIZE or COUNT is out of range')
    grid = int(words['WIDTH'][0]) * int(words['HEIGHT'][0])
    points = int(words['POINTS'][0]) if 'POINTS' in words else grid
    if points != grid:
        raise ValueError(f'POINTS {points} is not WIDTH times HEIGHT, {grid}')
    data = words['DATA'][0].lower()
    if data not in ('ascii', 'binary', 'binary_compressed'):
        raise ValueError(f'DATA {data} is not ascii, binary or binary_compressed')
    kinds = [_pcd_kind(type_, size) for type_, size in zip(types, sizes)]
    return Header(points, tuple(map(Field, names, kinds, counts)), data)


def _pcd_kind(type_: str, size: int) -> str:
    kind = PCD_TYPES.get(f'{type_}{size}')
    return f'<{kind}' if kind else f'V{size}'


def _ply_kind(name: str, order: str) -> str:
    if name == 'list':
        return LIST
    if name not in PLY_TYPES:
        raise ValueError(f'a property is of the unknown type {name}')
    return order + PLY_TYPES[name]


def _ply(lines: list[list[str]]) -> Header:
    form = next((line[1] for line in lines if line[0] == 'format'), '')
    if form not in PLY_ORDERS:
        raise ValueError(f'format {form!r} is not {", ".join(PLY_ORDERS)}')
    elements: dict[str, tuple[int, list[Field]]] = {}
    fields: list[Field] = []
    for line in lines:
        if line[0] == 'element':
            if line[1] in elements:
                raise ValueError(f'element {line[1]} stands twice')
            fields = []
            elements[line[1]] = int(line[2]), fields
        elif line[0] == 'property':
            fields.append(Field(line[-1], _ply_kind(line[1], PLY_ORDERS[form])))
    rows, vertex = elements['vertex']
    before = [elements[name] for name in list(elements)[: list(elements).index('vertex')]]
    text = form == 'ascii'
    for _, own in (elements['vertex'], *(() if text else before)):
        if any(field.kind == LIST for field in own):
            raise ValueError('it has lists in or before its vertices')
    lines_or_bytes = [count * (1 if text else sum(f.size for f in own)) for count, own in before]
    if any(count < 0 for count, _ in before):
        raise ValueError('an element has fewer than no rows')
    return Header(rows, tuple(vertex), 'ascii' if text else 'binary', sum(lines_or_bytes))
