"""Which voxels a convolution reads: the neighbour tables of a whole U-Net.

Keys are sorted with z fastest, so the 3 (or 5) voxels of a column are found by one binary search
and consecutive comparisons: 9 searches instead of 27, with queries in cache order. The compiled
twin (native/kernel_map.cpp) walks through both lists instead and finds the same rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import torch
from jaxtyping import Int32, Int64

from gcl_core.ops.native.kernels import search as search_kernel
from gcl_core.ops.voxelize import AXIS_BITS, coarsen, refine


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


def search(
    keys: Int64[torch.Tensor, ' n'], centres: Int64[torch.Tensor, ' m'], kernel: int
) -> Int32[torch.Tensor, 'k m']:
    """Find the rows of `keys` at every offset of a `kernel`^3 cube around each of `centres`.

    Both are sorted. Offsets run x slowest, z fastest, from -(kernel // 2); a missing voxel gives
    `len(keys)`.
    """
    half = kernel // 2
    missing = len(keys)
    padded = torch.cat([keys, keys.new_full((kernel,), torch.iinfo(torch.int64).max)])
    rows = []
    for dx in range(-half, half + 1):
        for dy in range(-half, half + 1):
            query = centres + ((dx << 2 * AXIS_BITS) + (dy << AXIS_BITS) - half)
            row = torch.searchsorted(keys, query)
            for dz in range(kernel):
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


def same_map(keys: Int64[torch.Tensor, ' n'], kernel: int) -> KernelMap:
    """Map of a convolution that keeps the voxels as they are (stride 1)."""
    compiled = search_kernel(keys, keys, kernel, axis_bits=AXIS_BITS)
    return KernelMap(search(keys, keys, kernel) if compiled is None else compiled[0], len(keys))


def down_map(fine: Int64[torch.Tensor, ' n'], coarse: Int64[torch.Tensor, ' m']) -> KernelMap:
    """Map of a kernel-3 stride-2 convolution from `fine` to `coarse = unique(coarsen(fine))`."""
    corners = refine(coarse)
    compiled = search_kernel(fine, corners, 3, axis_bits=AXIS_BITS, with_inverse=True)
    if compiled is not None:
        return KernelMap(compiled[0], len(fine), compiled[1])
    found = search(fine, corners, 3)
    return KernelMap(found, len(fine), invert(found, len(fine)))


@dataclass(frozen=True)
class Pyramid:
    """All levels of a U-Net over one batch, and every map between and within them.

    Attributes:
        keys: voxel keys of each level, finest first; level i has stride 2^i.
        parent: row in level i + 1 of each voxel of level i.
        stem: map of the first convolution (kernel 5) on level 0.
        same: kernel-3 stride-1 map of each level.
        down: kernel-3 stride-2 map from level i to i + 1; its transpose goes back up.
    """

    keys: tuple[Int64[torch.Tensor, ' n'], ...]
    parent: tuple[Int64[torch.Tensor, ' n'], ...]
    stem: KernelMap
    same: tuple[KernelMap, ...]
    down: tuple[KernelMap, ...]


def build_pyramid(
    keys: Int64[torch.Tensor, ' n'], *, levels: int, stem_kernel: int, finest_block: int = 0
) -> Pyramid:
    """Compute every map once.

    Args:
        keys: sorted voxel keys of level 0.
        levels: number of levels, strides 1 to 2^(levels - 1).
        stem_kernel: edge of the first convolution's kernel.
        finest_block: first level with stride-1 convolutions other than the stem; levels below it
            get an empty map.
    """
    all_keys, parents = [keys], []
    for _ in range(levels - 1):
        coarse, parent = torch.unique(coarsen(all_keys[-1]), return_inverse=True)
        all_keys.append(coarse)
        parents.append(parent)
    empty = KernelMap(torch.empty(27, 0, dtype=torch.int32, device=keys.device), 0)
    return Pyramid(
        keys=tuple(all_keys),
        parent=tuple(parents),
        stem=same_map(keys, stem_kernel),
        same=tuple(
            same_map(level_keys, 3) if level >= finest_block else empty
            for level, level_keys in enumerate(all_keys)
        ),
        down=tuple(down_map(fine, coarse) for fine, coarse in pairwise(all_keys)),
    )
