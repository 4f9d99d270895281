"""Several processes of one run, started by `torchrun`; by default there is one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from datetime import timedelta
from typing import cast

import torch
from torch import distributed, nn

from gcl_core.errors import GclError


@dataclass(frozen=True)
class Processes:
    """Which process of how many this is.

    Attributes:
        rank: of this process, from 0.
        count: of processes.
        device: where this process computes.
    """

    rank: int = 0
    count: int = 1
    device: torch.device = field(default_factory=lambda: torch.device('cpu'))

    @property
    def first(self) -> bool:
        """Whether this is the process that logs and saves."""
        return self.rank == 0

    def share(self, batch: int) -> int:
        """Samples of a step that this process takes.

        Raises:
            GclError: the batch cannot be divided evenly.
        """
        if batch % self.count:
            raise GclError(
                f'batch is {batch}, which {self.count} processes cannot share evenly; '
                f'choose a multiple of {self.count}'
            )
        return batch // self.count

    def parallel(self, model: nn.Module) -> nn.Module:
        """Wrap the model so that gradients are averaged over the processes."""
        if self.count == 1:
            return model
        ids = [self.device] if self.device.type == 'cuda' else None
        return nn.parallel.DistributedDataParallel(model, device_ids=ids, broadcast_buffers=False)

    def mean(self, row: dict[str, float]) -> dict[str, float]:
        """Average figures over the processes; all must have the same keys."""
        if self.count == 1:
            return row
        values = torch.tensor(list(row.values()), dtype=torch.float64, device=self.device)
        distributed.all_reduce(values)
        return dict(zip(row, (values / self.count).tolist(), strict=True))

    def gather(self, text: str) -> list[str]:
        """Collect a text of every process, in their order; all get all of them."""
        if self.count == 1:
            return [text]
        own = torch.frombuffer(bytearray(text.encode() or b' '), dtype=torch.uint8)
        own = own.to(self.device)
        sizes = [torch.zeros(1, dtype=torch.int64, device=self.device) for _ in range(self.count)]
        distributed.all_gather(sizes, torch.tensor([len(own)], device=self.device))
        longest = max(int(size) for size in sizes)
        padded = nn.functional.pad(own, (0, longest - len(own)))
        all_ = [torch.empty_like(padded) for _ in range(self.count)]
        distributed.all_gather(all_, padded)
        return [
            row[: int(size)].cpu().numpy().tobytes().decode().strip(' ')
            for row, size in zip(all_, sizes)
        ]

    def synchronised(self, model: nn.Module, *, last: bool) -> AbstractContextManager[None]:
        """Let only the last backward pass of a step exchange gradients."""
        if last or not isinstance(model, nn.parallel.DistributedDataParallel):
            return nullcontext()
        return cast(AbstractContextManager[None], model.no_sync())


@contextmanager
def processes(patience: timedelta | None = None) -> Iterator[Processes]:
    """Join the run that `torchrun` has set up, if it has; leave it at the end.

    Args:
        patience: how long one process waits for another; None: torch's default.
    """
    cuda = torch.cuda.is_available()
    local = int(os.environ.get('LOCAL_RANK', '0'))
    device = torch.device('cuda', local) if cuda else torch.device('cpu')
    if 'RANK' not in os.environ:
        yield Processes(device=device)
        return
    distributed.init_process_group('nccl' if cuda else 'gloo', timeout=patience)
    try:
        yield Processes(distributed.get_rank(), distributed.get_world_size(), device)
    finally:
        distributed.destroy_process_group()
