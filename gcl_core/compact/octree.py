"""Occupied voxels as an octree, entropy coded: what makes a scan small.

Nodes are coded breadth first, those of a level in the order of their keys. Each of a node's 8
children is one binary decision, written by a range coder at the probability that its context has:
which of the cells before it are occupied, which nodes lie behind it, which child of which level it
is. Probabilities start as `priors` has them and follow the scan by 1/32 of each error.

The functions here are the definition, in integers, so that every machine writes and reads the same
bytes. The compiled twin (ops/native/octree.cpp) does the same some hundred times faster.
"""

from __future__ import annotations

from functools import cache
from typing import Protocol

import numpy as np
from jaxtyping import Int64, UInt16

from gcl_core.compact.range_coder import RangeDecoder, RangeEncoder
from gcl_core.errors import GclError
from gcl_core.ops.native import octree as native

AXIS_BITS = 16
AXIS = (1 << AXIS_BITS) - 1
DEEPEST = AXIS_BITS - 1  # levels, so that a neighbour beyond the grid is no voxel of it
RATE = 5  # a probability moves by 1/32 of its error
CONTEXTS = 1 << 18
LEVEL_CLASSES = 4  # finest, second, third, the rest

# Nodes around one. Cells of the first 10 are read where they are coded already; the last 3 lie
# behind a node on each axis, and it counts whether they exist.
AROUND = (
    *((-1, 0, 0), (0, -1, 0), (0, 0, -1), (-1, -1, 0), (-1, 0, -1), (0, -1, -1), (-1, -1, -1)),
    *((-1, 1, 0), (-1, 0, 1), (0, -1, 1)),
    *((1, 0, 0), (0, 1, 0), (0, 0, 1)),
)
READ = 10


class Coder(Protocol):
    """Writes decisions, or reads them."""

    def code(self, bit: int, probability: int, /) -> int:
        """Code a decision of this probability, of 65,536; returns it."""


def pack(x: int, y: int, z: int) -> int:
    """Key of a voxel; keys are sorted by x, y, z."""
    return (x << 2 * AXIS_BITS) + (y << AXIS_BITS) + z


def unpack(key: int) -> tuple[int, int, int]:
    """Coordinates of a key."""
    return key >> 2 * AXIS_BITS, key >> AXIS_BITS & AXIS, key & AXIS


def encode(
    keys: Int64[np.ndarray, ' n'], depth: int, priors: UInt16[np.ndarray, ' contexts']
) -> bytes:
    """Write voxels; `decode` reads them.

    Args:
        keys: sorted, each once, coordinates below 2^depth.
        depth: levels, 0 to 15.
        priors: probabilities to begin with, of 65,536.
    """
    if len(keys) == 0 or depth == 0:
        return b''
    compiled = native.encode(keys, depth, priors)
    return _encode(keys, depth, priors) if compiled is None else compiled


def decode(
    data: bytes, depth: int, count: int, priors: UInt16[np.ndarray, ' contexts']
) -> Int64[np.ndarray, ' count']:
    """Read voxels; takes memory and time for `count` nodes a level, whatever the bytes say.

    Raises:
        GclError: the bytes hold another number of voxels.
    """
    if count == 0 or depth == 0:
        return np.zeros(min(count, 1), np.int64)
    found = native.decode(data, depth, count, priors)
    keys = _decode(data, depth, count, priors) if found is None else found
    if len(keys) != count:
        raise GclError(f'the octree does not hold the {count} voxels that its header names')
    return keys


def levels_of(keys: Int64[np.ndarray, ' n'], depth: int) -> list[dict[int, int]]:
    """Children of each node of each level, a bit each; coarsest level first."""
    levels: list[dict[int, int]] = []
    nodes = keys.tolist()
    for _ in range(depth):
        children: dict[int, int] = {}
        for key in nodes:
            x, y, z = unpack(key)
            parent, child = pack(x >> 1, y >> 1, z >> 1), (x & 1) << 2 | (y & 1) << 1 | z & 1
            children[parent] = children.get(parent, 0) | 1 << child
        levels.append(children)
        nodes = sorted(children)
    return levels[::-1]


def _encode(keys: np.ndarray, depth: int, priors: np.ndarray) -> bytes:
    coder = RangeEncoder()
    probabilities = priors.tolist()
    for level, children in enumerate(levels_of(keys, depth)):
        code_level(coder, children, depth - 1 - level, probabilities)
    return coder.finish()


def _decode(data: bytes, depth: int, count: int, priors: np.ndarray) -> Int64[np.ndarray, ' n']:
    coder = RangeDecoder(data)
    probabilities = priors.tolist()
    nodes = [0]
    for above_finest in reversed(range(depth)):
        children = dict.fromkeys(nodes, 0)
        code_level(coder, children, above_finest, probabilities)
        nodes = sorted(
            pack(2 * x + (child >> 2), 2 * y + (child >> 1 & 1), 2 * z + (child & 1))
            for (x, y, z), byte in ((unpack(key), byte) for key, byte in children.items())
            for child in range(8)
            if byte >> child & 1
        )
        if len(nodes) > count:
            break
    return np.array(nodes, np.int64)


def code_level(
    coder: Coder, children: dict[int, int], above_finest: int, probabilities: list[int]
) -> None:
    """Code the children of each node of a level.

    Args:
        coder: writes or reads each decision.
        children: of each node, a bit each; filled where they are read.
        above_finest: levels between this one and the last.
        probabilities: of each context; they follow the decisions.
    """
    coded: dict[int, int] = {}
    level_class = min(above_finest, LEVEL_CLASSES - 1)
    for node in sorted(children):
        occupied, behind = _around(node, children, coded)
        byte = 0
        for child in range(8):
            if child == 7 and byte == 0:  # a node has a child
                byte = 1 << child
                break
            cells = _neighbors(child)
            near = sum(1 << o for o in range(7) if cells[o] in occupied)
            more = sum(1 << o - 7 for o in range(7, READ) if cells[o] in occupied)
            faces = behind & (child >> 2 | child & 2 | (child & 1) << 2)
            context = (((level_class << 7 | near) << 3 | faces) << 3 | child) << 3 | more
            p = probabilities[context]
            bit = coder.code(children[node] >> child & 1, p)
            probabilities[context] = p + (65536 - p >> RATE) if bit else p - (p >> RATE)
            if bit:
                byte |= 1 << child
                occupied.add(_place(child, (0, 0, 0)))
        coded[node] = byte
    children.update(coded)


def _around(
    node: int, nodes: dict[int, int], coded: dict[int, int]
) -> tuple[set[tuple[int, int, int]], int]:
    """Occupied cells around a node as far as they are coded, and which nodes lie behind it."""
    occupied: set[tuple[int, int, int]] = set()
    behind = 0
    for number, offset in enumerate(AROUND):
        other = node + pack(*offset)
        if number >= READ:
            behind |= (other in nodes) << number - READ
        elif byte := coded.get(other, 0):
            occupied.update(_place(child, offset) for child in range(8) if byte >> child & 1)
    return occupied, behind


def _place(child: int, offset: tuple[int, int, int]) -> tuple[int, int, int]:
    """Cell of a child of the node at `offset`, where the node at hand has 0 and 1 on each axis."""
    x, y, z = offset
    return 2 * x + (child >> 2), 2 * y + (child >> 1 & 1), 2 * z + (child & 1)


@cache
def _neighbors(child: int) -> tuple[tuple[int, int, int], ...]:
    """Cells around a child that its context names."""
    x, y, z = _place(child, (0, 0, 0))
    return tuple((x + dx, y + dy, z + dz) for dx, dy, dz in AROUND[:READ])
