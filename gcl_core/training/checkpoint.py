"""Checkpoints as safetensors: weights, optimiser state and step, written atomically."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from gcl_core.errors import GclError


@dataclass(frozen=True)
class State:
    """What a run has learnt so far.

    Attributes:
        model: the network.
        optimizer: with its running moments.
        average: moving average of the network, if the recipe keeps one.
    """

    model: torch.nn.Module
    optimizer: torch.optim.Optimizer
    average: torch.nn.Module | None


def save(path: Path, state: State, step: int, config: dict[str, Any]) -> None:
    """Write to a temporary file and rename it, so that a kill leaves the last one whole."""
    tensors = {f'model.{name}': t.contiguous() for name, t in state.model.state_dict().items()}
    for index, moments in state.optimizer.state_dict()['state'].items():
        tensors.update({f'optimizer.{index}.{k}': t for k, t in moments.items() if t is not None})
    if state.average:
        averaged = state.average.state_dict()
        tensors.update({f'average.{name}': t.clone() for name, t in averaged.items()})
    temporary = path.with_suffix('.tmp')
    metadata = {'step': str(step), 'config': json.dumps(config)}
    save_file(tensors, temporary, metadata=metadata)
    os.replace(temporary, path)


def load(path: Path, state: State) -> int:
    """Restore a state in place; return the step to go on with.

    Raises:
        GclError: the file is damaged, or of another network.
    """
    parts: dict[str, dict[str, torch.Tensor]] = {'model': {}, 'optimizer': {}, 'average': {}}
    try:
        with safe_open(path, framework='pt') as file:
            step = int(file.metadata()['step'])
            for name in file.keys():  # noqa: SIM118 (not a dict)
                kind, rest = name.split('.', 1)
                parts[kind][rest] = file.get_tensor(name)
        state.model.load_state_dict(parts['model'])
        if state.average:
            state.average.load_state_dict(parts['average'])
    except (SafetensorError, KeyError, RuntimeError) as error:
        raise GclError(
            f'{path} is damaged or holds another network; remove it to start anew ({error})'
        ) from None
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for name, tensor in parts['optimizer'].items():
        index, key = name.split('.', 1)
        moments.setdefault(int(index), {})[key] = tensor
    state.optimizer.load_state_dict({**state.optimizer.state_dict(), 'state': moments})
    return step
