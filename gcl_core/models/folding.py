"""What a network folds for inference: a product and the batch norm behind it become one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import torch
from torch import nn

F = TypeVar('F')


class Folding(nn.Module, Generic[F]):
    """A module that keeps what it has folded, by dtype, as long as its weights stay."""

    def __init__(self) -> None:
        super().__init__()
        self._folded: dict[torch.dtype, F] = {}

    def train(self, mode: bool = True) -> Folding[F]:
        """Switch mode; what was folded is forgotten, the weights may change."""
        self._folded.clear()
        return super().train(mode)

    def folded(self, dtype: torch.dtype, fold: Callable[[], F]) -> F | None:
        """What `fold` makes, once; none while gradients are wanted."""
        if self.training or torch.is_grad_enabled():
            return None
        if dtype not in self._folded:
            self._folded[dtype] = fold()
        return self._folded[dtype]
