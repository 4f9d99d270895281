"""Which voxels a convolution reads: the neighbour tables of a whole U-Net.

Keys are sorted with z fastest, so the voxels of a column are found by one binary search and
consecutive comparisons: for a cube of edge 3, 9 searches instead of 27, with queries in cache
order. The compiled twins (native/kernel_map.cpp, coarsen.cpp) walk through both lists instead and
find the same rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import torch
from jaxtyping import Int32, Int64

from gcl_core.ops.native import kernel_map as native
from gcl_core.ops.voxelize import AXIS_BITS, coarsen, refine

UPPER_CORNER = (1 << 2 * AXIS_BITS) + (1 << AXIS_BITS) + 1  # from a key to that of (+1, +1, +1)


@dataclass(frozen=True)
class KernelMap:
    """Rows that each output voxel reads, one list for each kernel offset.

    Attributes:
        neighbors: row of the input voxel at each offset, `num_inputs` where there is none.
        num_inputs: number of input voxels.
        other_side: the same pairs from the inputs' side, see `inverse`; None if the map is its
            own mirror image (stride 1).
    """

    neighbors: Int32[torch.Tensor, 'k n_out']
    num_inputs: int
    other_side: Int32[torch.Tensor, 'k n_in'] | None = None

    @property
    def num_outputs(self) -> int:
        """Number of output voxels."""
        return self.neighbors.shape[1]

    @cached_property
    def inverse(self) -> Int32[torch.Tensor, 'k n_in']:
        """Output row that reads each input through each offset, `num_outputs` where none does.

        What the backward pass gathers by.
        """
        return self.neighbors.flip(0) if self.other_side is None else self.other_side

    def transposed(self) -> KernelMap:
        """Map of the transposed convolution: coarse to fine over the same pairs of voxels."""
        return KernelMap(self.inverse, self.num_outputs, self.neighbors)


@dataclass(frozen=True)
class KernelShape:
    """Voxels that a convolution reads around each output voxel.

    Attributes:
        edge: along x and along y.
        height: along z.
    """

    edge: int
    height: int

    @classmethod
    def cube(cls, edge: int) -> KernelShape:
        """As high as it is wide."""
        return cls(edge, edge)

    @property
    def offsets(self) -> int:
        """Number of offsets: x slowest, z fastest."""
        return self.edge**2 * self.height


def search(
    keys: Int64[torch.Tensor, ' n'], centres: Int64[torch.Tensor, ' m'], shape: KernelShape
) -> Int32[torch.Tensor, 'k m']:
    """Find the rows of `keys` at every offset of a kernel around each of `centres`.

    Both are sorted. Offsets run x slowest, z fastest, from -(length // 2) on each axis; a missing
    voxel gives `len(keys)`.
    """
    first = shape.edge // 2
    missing = len(keys)
    padded = torch.cat([keys, keys.new_full((shape.height,), torch.iinfo(torch.int64).max)])
    rows = []
    for dx in range(-first, shape.edge - first):
        for dy in range(-first, shape.edge - first):
            offset = (dx << 2 * AXIS_BITS) + (dy << AXIS_BITS) - shape.height // 2
            query = centres + offset
            row = torch.searchsorted(keys, query)
            for dz in range(shape.height):
                hit = padded[row] == query + dz
                rows.append(torch.where(hit, row, missing).int())
                row += hit
    return torch.stack(rows)


def invert(rows: Int32[torch.Tensor, 'k m'], num_inputs: int) -> Int32[torch.Tensor, 'k n']:
    """Swap the two sides of a table: at each offset, the column that names each row."""
    kernel, columns = rows.shape
    other = rows.new_full((kernel, num_inputs + 1), columns)  # the last takes what is missing
    numbers = torch.arange(columns, dtype=torch.int32, device=rows.device)
    other.scatter_(1, rows.long(), numbers.expand_as(rows))
    return other[:, :num_inputs].contiguous()


def same_map(keys: Int64[torch.Tensor, ' n'], shape: KernelShape) -> KernelMap:
    """Map of a convolution that keeps the voxels as they are (stride 1, odd lengths)."""
    compiled = native.search_same(keys, (shape.edge, shape.height), axis_bits=AXIS_BITS)
    return KernelMap(search(keys, keys, shape) if compiled is None else compiled, len(keys))


def halved(
    keys: Int64[torch.Tensor, ' n'],
) -> tuple[Int64[torch.Tensor, ' m'], Int64[torch.Tensor, ' n']]:
    """Voxels of twice the size, and which of them each voxel lies in."""
    coarse = coarsen(keys)
    compiled = native.unique(coarse, axis_bits=AXIS_BITS)
    return compiled or torch.unique(coarse, return_inverse=True)


def down_map(
    fine: Int64[torch.Tensor, ' n'],
    coarse: Int64[torch.Tensor, ' m'],
    edge: int = 3,
    parent: Int64[torch.Tensor, ' n'] | None = None,
) -> KernelMap:
    """Map of a stride-2 convolution from `fine` to `coarse = unique(coarsen(fine))`.

    A cube of an odd edge lies around the first of a coarse voxel's 2^3 fine ones (torch's conv3d
    with padding edge // 2), one of an even edge around the middle of them (padding edge // 2 - 1).

    Args:
        fine: keys of the input voxels.
        coarse: of the output voxels.
        edge: of the kernel.
        parent: row in `coarse` of each of `fine`, where it is known: for an edge of 2 it is the
            map.
    """
    compiled: tuple[torch.Tensor, torch.Tensor | None] | None
    centres = refine(coarse) + (0 if edge % 2 else UPPER_CORNER)
    if edge == 2 and parent is not None:
        compiled = native.halving_map(fine, parent, len(coarse), axis_bits=AXIS_BITS)
    else:
        shape = (edge, edge)
        compiled = native.search(fine, centres, shape, axis_bits=AXIS_BITS, with_inverse=True)
    if compiled is not None:
        return KernelMap(compiled[0], len(fine), compiled[1])
    found = search(fine, centres, KernelShape.cube(edge))
    return KernelMap(found, len(fine), invert(found, len(fine)))


CUBE_3 = KernelShape.cube(3)


@dataclass(frozen=True)
class Pyramid:
    """All levels of a U-Net over one batch, and every map between and within them.

    Attributes:
        keys: voxel keys of each level, finest first; level i has stride 2^i.
        parent: row in level i + 1 of each voxel of level i.
        stem: map of the first convolution on level 0.
        same: stride-1 map of each level.
        down: stride-2 map from level i to i + 1; its transpose goes back up.
    """

    keys: tuple[Int64[torch.Tensor, ' n'], ...]
    parent: tuple[Int64[torch.Tensor, ' n'], ...]
    stem: KernelMap
    same: tuple[KernelMap, ...]
    down: tuple[KernelMap, ...]


def build_pyramid(
    keys: Int64[torch.Tensor, ' n'],
    *,
    levels: int,
    stem: KernelShape,
    block: KernelShape = CUBE_3,
    down: int = 3,
    finest_block: int = 0,
) -> Pyramid:
    """Compute every map once.

    Args:
        keys: sorted voxel keys of level 0.
        levels: number of levels, strides 1 to 2^(levels - 1).
        stem: kernel of the first convolution.
        block: kernel of the other stride-1 convolutions.
        down: edge of the stride-2 kernels.
        finest_block: first level with stride-1 convolutions other than the stem; levels below it
            get an empty map.
    """
    all_keys, parents = [keys], []
    for _ in range(levels - 1):
        coarse, parent = halved(all_keys[-1])
        all_keys.append(coarse)
        parents.append(parent)
    empty = KernelMap(torch.empty(block.offsets, 0, dtype=torch.int32, device=keys.device), 0)
    return Pyramid(
        keys=tuple(all_keys),
        parent=tuple(parents),
        stem=same_map(keys, stem),
        same=tuple(
            same_map(level_keys, block) if level >= finest_block else empty
            for level, level_keys in enumerate(all_keys)
        ),
        down=tuple(
            down_map(fine, coarse, down, parent)
            for (fine, coarse), parent in zip(pairwise(all_keys), parents)
        ),
    )
