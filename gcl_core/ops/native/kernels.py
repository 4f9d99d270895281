"""The compiled kernels as functions of tensors."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import torch
from jaxtyping import Float, Int32

from gcl_core.ops.native.build import library

SUFFIX = {torch.float32: 'f32', torch.bfloat16: 'bf16'}
POINTER, LONG, INT = ctypes.c_void_p, ctypes.c_long, ctypes.c_int


class Address(ctypes.c_void_p):
    """Where the numbers of a contiguous tensor are, for a compiled function; keeps it alive."""

    tensor: torch.Tensor


def at(tensor: torch.Tensor) -> Address:
    """Point a compiled function at a contiguous tensor."""
    address = Address(tensor.data_ptr())
    address.tensor = tensor
    return address


@dataclass(frozen=True)
class PackedWeight:
    """A weight in the order that the kernel reads it.

    Attributes:
        data: flat, in the features' dtype.
        library: whose order it is: each instruction set has its own.
        kernel, in_channels, out_channels: shape of the weight.
    """

    data: torch.Tensor
    library: str
    kernel: int
    in_channels: int
    out_channels: int


class Kernels:
    """Kernels for one dtype of features."""

    def __init__(self, lib: ctypes.CDLL, dtype: torch.dtype) -> None:
        self.dtype = dtype
        self._library = str(lib._name)
        suffix = SUFFIX[dtype]
        signatures = {
            'packed_size': (LONG,) * 3,
            'pack': (POINTER, LONG, LONG, LONG, INT, POINTER),
            'conv': (
                *(POINTER, INT, LONG, POINTER, LONG, LONG),
                *(POINTER, LONG, POINTER, POINTER, INT, POINTER, INT),
            ),
            'weight_grad': (POINTER, INT, LONG, POINTER, LONG, LONG, POINTER, LONG, POINTER, INT),
        }
        self._call: dict[str, Callable[..., Any]] = {}
        for name, arguments in signatures.items():
            function = getattr(lib, f'gcl_{name}_{suffix}')
            function.argtypes = arguments
            function.restype = LONG if name == 'packed_size' else None
            self._call[name] = function

    def pack(
        self, weight: Float[torch.Tensor, 'k c_in c_out'], *, transposed: bool = False
    ) -> PackedWeight:
        """Pack a float32 weight; `transposed` swaps its channels, for the gradient."""
        weight = weight.detach().float().contiguous()
        kernel, c_in, c_out = weight.shape
        if transposed:
            c_in, c_out = c_out, c_in
        size = self._call['packed_size'](kernel, c_in, c_out)
        data = torch.empty(size, dtype=self.dtype)
        self._call['pack'](at(weight), kernel, c_in, c_out, int(transposed), at(data))
        return PackedWeight(data, self._library, kernel, c_in, c_out)

    def convolve(
        self,
        x: Float[torch.Tensor, 'n_in c_in'],
        neighbors: Int32[torch.Tensor, 'k n_out'],
        weight: PackedWeight,
        *,
        bias: Float[torch.Tensor, ' c_out'] | None = None,
        residual: Float[torch.Tensor, 'n_out c_out'] | None = None,
        relu: bool = False,
    ) -> Float[torch.Tensor, 'n_out c_out']:
        """Sum `x[neighbors[j]] @ weight[j]`, plus bias and residual, then ReLU if asked for."""
        self._check(x, neighbors, weight.kernel)
        if weight.library != self._library:
            raise ValueError(f'the weight is packed for {weight.library}, not {self._library}')
        if x.shape[1] != weight.in_channels:
            raise ValueError(f'{x.shape[1]} channels, the weight has {weight.in_channels}')
        x = self._even(x)
        residual = None if residual is None else residual.contiguous()
        out = x.new_empty(neighbors.shape[1], weight.out_channels)
        self._call['conv'](
            *(at(x), len(x), x.shape[1]),
            *(at(neighbors), neighbors.shape[1], weight.kernel),
            *(at(weight.data), weight.out_channels),
            None if bias is None else at(bias),
            None if residual is None else at(residual),
            *(int(relu), at(out), torch.get_num_threads()),
        )
        return out

    def weight_grad(
        self,
        x: Float[torch.Tensor, 'n_in c_in'],
        neighbors: Int32[torch.Tensor, 'k n_out'],
        grad: Float[torch.Tensor, 'n_out c_out'],
    ) -> Float[torch.Tensor, 'k c_in c_out']:
        """Gradient of `convolve` with respect to its weight, float32."""
        self._check(x, neighbors, len(neighbors))
        x, grad = x.contiguous(), grad.contiguous()
        out = torch.empty(len(neighbors), x.shape[1], grad.shape[1])
        self._call['weight_grad'](
            *(at(x), len(x), x.shape[1]),
            *(at(neighbors), neighbors.shape[1], len(neighbors)),
            *(at(grad), grad.shape[1], at(out), torch.get_num_threads()),
        )
        return out

    def _check(self, x: torch.Tensor, neighbors: torch.Tensor, kernel: int) -> None:
        """Refuse what the kernels would misread."""
        if x.dtype != self.dtype or neighbors.dtype != torch.int32 or len(neighbors) != kernel:
            raise TypeError(f'{x.dtype} features, {neighbors.dtype} map of {len(neighbors)} rows')
        if not neighbors.is_contiguous():
            raise TypeError('a kernel map must be contiguous')

    def _even(self, x: torch.Tensor) -> torch.Tensor:
        """Two bfloat16 channels are read at a time: an odd one gets a channel of zeros."""
        if self.dtype == torch.bfloat16 and x.shape[1] % 2:
            x = torch.nn.functional.pad(x, (0, 1))
        return x.contiguous()


def kernels_for(x: torch.Tensor) -> Kernels | None:
    """Kernels for features of this dtype and device, or None: then torch does it."""
    lib = library() if x.device.type == 'cpu' and x.dtype in SUFFIX else None
    return None if lib is None else _kernels(lib, x.dtype)


_kernels = cache(Kernels)
