"""Checkpoints as safetensors: weights, optimiser state and step, written atomically."""

from __future__ import annotations

import json
import os
from pathlib import Path

import torch
from safetensors import safe_open
from safetensors.torch import save_file

from gcl_core.errors import GclError


def save(
    path: Path, model: torch.nn.Module, optimizer: torch.optim.Optimizer, step: int, config: dict
) -> None:
    """Write to a temporary file and rename it, so that a kill leaves the last one whole."""
    tensors = {f'model.{name}': t.contiguous() for name, t in model.state_dict().items()}
    for index, state in optimizer.state_dict()['state'].items():
        tensors.update({f'optimizer.{index}.{key}': t for key, t in state.items()})
    temporary = path.with_suffix('.tmp')
    metadata = {'step': str(step), 'config': json.dumps(config)}
    save_file(tensors, temporary, metadata=metadata)
    os.replace(temporary, path)


def load(path: Path, model: torch.nn.Module, optimizer: torch.optim.Optimizer) -> int:
    """Restore weights and optimiser state; return the step to go on with.

    Raises:
        GclError: the file is of another network.
    """
    weights: dict[str, torch.Tensor] = {}
    state: dict[int, dict[str, torch.Tensor]] = {}
    with safe_open(path, framework='pt') as file:
        step = int(file.metadata()['step'])
        for name in file.keys():  # noqa: SIM118 (not a dict)
            kind, rest = name.split('.', 1)
            if kind == 'model':
                weights[rest] = file.get_tensor(name)
            else:
                index, key = rest.split('.', 1)
                state.setdefault(int(index), {})[key] = file.get_tensor(name)
    try:
        model.load_state_dict(weights)
    except RuntimeError as error:
        raise GclError(
            f'{path} holds another network; remove it to start anew ({error})'
        ) from None
    optimizer.load_state_dict({**optimizer.state_dict(), 'state': state})
    return step
