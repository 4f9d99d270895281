"""Convolutions that know the quarter turns about z (p4; Cohen and Welling, ICML 2016).

Features have four blocks of channels, one for each quarter turn. A block is computed by the filter
of the first, turned; so a scan turned by 90 degrees has the features of the unturned one, its
blocks rolled by one. A turn takes point (x, y) to (-y, x) and voxel (i, j) to (-j - 1, i).

The filters of all blocks are expanded to the weight of an ordinary convolution, so that the
kernels are the same.
"""

from __future__ import annotations

import math
from functools import cache

import torch
from jaxtyping import Float, Int64
from torch import nn

from gcl_core.ops.kernel_map import KernelMap, KernelShape
from gcl_core.ops.kernel_points import points_turned_back
from gcl_core.ops.kpconv import Influences, kpconv
from gcl_core.ops.repeatable import linear
from gcl_core.ops.sparse_conv import FILL, sparse_conv

TURNS = 4


def roll_blocks(features: Float[torch.Tensor, 'n c'], turns: int) -> Float[torch.Tensor, 'n c']:
    """Return the features that a scan has when it is turned by `turns` quarter turns."""
    blocks = features.unflatten(1, (TURNS, -1))
    return blocks.roll(turns, 1).flatten(1)


def join_blocks(
    first: Float[torch.Tensor, 'n a'], second: Float[torch.Tensor, 'n b']
) -> Float[torch.Tensor, 'n a+b']:
    """Concatenate features block by block, so that blocks stay blocks."""
    parts = [features.unflatten(1, (TURNS, -1)) for features in (first, second)]
    return torch.cat(parts, 2).flatten(1)


TurnedBack = tuple[Int64[torch.Tensor, ' k'], ...]  # under 0, 1, 2 and 3 quarter turns


@cache
def offsets_turned_back(shape: KernelShape) -> TurnedBack:
    """Offset that each offset of a kernel comes from under 0, 1, 2 and 3 quarter turns."""
    # Whoever asks first may be describing; a tensor of inference mode could not be trained with.
    with torch.inference_mode(False):
        offsets = torch.arange(shape.offsets, device='cpu')
        grid = offsets.reshape(shape.edge, shape.edge, shape.height)
        return tuple(torch.rot90(grid, turns, (0, 1)).flatten() for turns in range(TURNS))


def expand(
    filters: Float[torch.Tensor, 'k blocks c_in c_out'], turned_back: TurnedBack
) -> Float[torch.Tensor, 'k blocks*c_in 4*c_out']:
    """Write the filters of the first block as the weight of all four.

    `filters[k, h]` reads input block h at offset k. Output block g reads block g + h by the same
    filter, its offset turned by g (Cohen and Welling, eq. 11). An input of one block, which knows
    no turns, is read by every output block.

    Args:
        filters: of an output block.
        turned_back: which offset each offset comes from.
    """
    turned = []
    for turns, source in enumerate(turned_back):
        block = filters[source.to(filters.device)]
        turned.append(block.roll(turns, 1) if filters.shape[1] > 1 else block)
    return torch.stack(turned, 3).flatten(3).flatten(1, 2)


class QuarterTurnConv(nn.Module):
    """Sparse convolution without bias of features in four blocks.

    Args:
        in_channels: of all blocks, or of an input that knows no turns.
        out_channels: of all four blocks.
        shape: its kernel.
        lifts: the input knows no turns, as that of a network.
    """

    def __init__(
        self, in_channels: int, out_channels: int, shape: KernelShape, *, lifts: bool = False
    ) -> None:
        super().__init__()
        self.shape = shape
        blocks = 1 if lifts else TURNS
        self.filters = nn.Parameter(
            torch.empty(shape.offsets, blocks, in_channels // blocks, out_channels // TURNS)
        )
        std = math.sqrt(2.0 / (FILL * shape.offsets * in_channels))
        if not self.filters.is_meta:
            nn.init.normal_(self.filters, std=std)

    @property
    def weight(self) -> Float[torch.Tensor, 'k c_in c_out']:
        """Of the ordinary convolution that this one is."""
        return expand(self.filters, offsets_turned_back(self.shape))

    def forward(
        self, x: Float[torch.Tensor, 'n_in c_in'], kmap: KernelMap
    ) -> Float[torch.Tensor, 'n_out c_out']:
        """Convolve over `kmap`."""
        return sparse_conv(x, self.weight, kmap)


class QuarterTurnKPConv(nn.Module):
    """Kernel point convolution of features in four blocks, without bias.

    Args:
        in_channels: of all blocks, or of an input that knows no turns.
        out_channels: of all four blocks.
        kernel: kernel points, in orbits (`kernel_points(kernel, in_orbits=True)`).
        lifts: the input knows no turns, as that of a network.
    """

    def __init__(
        self, in_channels: int, out_channels: int, kernel: int, *, lifts: bool = False
    ) -> None:
        super().__init__()
        self._turned_back = tuple(
            torch.from_numpy(points) for points in points_turned_back(kernel, TURNS)
        )
        blocks = 1 if lifts else TURNS
        self.filters = nn.Parameter(
            torch.empty(kernel, blocks, in_channels // blocks, out_channels // TURNS)
        )
        if not self.filters.is_meta:
            nn.init.normal_(self.filters, std=math.sqrt(2.0 / (kernel * in_channels)))

    @property
    def weight(self) -> Float[torch.Tensor, 'p c_in c_out']:
        """Of the ordinary convolution that this one is."""
        return expand(self.filters, self._turned_back)

    def forward(
        self, x: Float[torch.Tensor, 'n c_in'], felt: Influences
    ) -> Float[torch.Tensor, 'm c_out']:
        """Convolve; computes in the dtype of `x`."""
        return kpconv(x, self.weight, felt)


class QuarterTurnLinear(nn.Module):
    """A product of features in four blocks, with a bias that they share if asked for.

    Args:
        in_channels, out_channels: of all four blocks.
        bias: whether there is one.
    """

    def __init__(self, in_channels: int, out_channels: int, *, bias: bool) -> None:
        super().__init__()
        self.filters = nn.Parameter(
            torch.empty(1, TURNS, in_channels // TURNS, out_channels // TURNS)
        )
        self.bias = nn.Parameter(torch.zeros(out_channels // TURNS)) if bias else None
        if not self.filters.is_meta:
            nn.init.uniform_(self.filters, -(in_channels**-0.5), in_channels**-0.5)

    @property
    def weight(self) -> Float[torch.Tensor, 'c_in c_out']:
        """Of the ordinary product that this one is."""
        return expand(self.filters, offsets_turned_back(POINT))[0]

    def forward(self, x: Float[torch.Tensor, 'n c_in']) -> Float[torch.Tensor, 'n c_out']:
        """Multiply every row; without a gradient the same bits by any number of threads."""
        weight = self.weight
        bias = None if self.bias is None else self.bias.repeat(TURNS)
        if not torch.is_grad_enabled():
            return linear(x, weight, bias)
        return x @ weight if bias is None else x @ weight + bias


class QuarterTurnNorm(nn.BatchNorm1d):
    """Batch norm whose statistics and weights the four blocks share.

    Args:
        channels: of all four blocks.
        momentum: of the running statistics.
    """

    def __init__(self, channels: int, momentum: float) -> None:
        super().__init__(channels // TURNS, momentum=momentum)

    def forward(self, x: Float[torch.Tensor, 'n c']) -> Float[torch.Tensor, 'n c']:
        """Normalise each channel over all rows and blocks."""
        return super().forward(x.reshape(len(x) * TURNS, -1)).reshape(x.shape)


POINT = KernelShape.cube(1)
