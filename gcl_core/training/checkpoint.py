"""Checkpoints as safetensors: weights, optimiser state and step, written atomically."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from gcl_core.errors import GclError
from gcl_core.files import whole_file

FORMAT = 'gcl-checkpoint-2'
# What of a recipe stays as it is from the first step on.
FIXED = ('network', 'samples', 'groups', 'batch', 'seed', 'start')


@dataclass(frozen=True)
class State:
    """What a run has learnt so far.

    Attributes:
        model: the network.
        optimizer: with its running moments, which a file keeps under their parameters' names.
        average: moving average of the network, if the recipe keeps one.
    """

    model: torch.nn.Module
    optimizer: torch.optim.Optimizer
    average: torch.nn.Module | None


class Resumed(NamedTuple):
    """Where a run stands: steps taken, and the SHA-256 of the weights that it began from."""

    step: int
    start_sha256: str


def save(
    path: Path, state: State, step: int, config: dict[str, Any], start_sha256: str = ''
) -> None:
    """Write a checkpoint; a kill, or a full disk, leaves the last one whole.

    Raises:
        GclError: it cannot be written; the last one is still there.
    """
    tensors = {f'model.{name}': t.contiguous() for name, t in state.model.state_dict().items()}
    for name, parameter in state.model.named_parameters():
        moments = state.optimizer.state.get(parameter, {}).items()
        tensors.update({f'optimizer.{name}.{key}': t for key, t in moments if t is not None})
    if state.average:
        averaged = state.average.state_dict()
        tensors.update({f'average.{name}': t.clone() for name, t in averaged.items()})
    metadata = {'format': FORMAT, 'step': str(step), 'config': json.dumps(config)}
    metadata['start_sha256'] = start_sha256
    with whole_file(path) as part:
        save_file(tensors, part, metadata=metadata)


def load(path: Path, state: State, config: dict[str, Any] | None = None) -> Resumed:
    """Restore a state in place; return where to go on.

    Args:
        path: file.
        state: to restore.
        config: recipe to go on with.

    Raises:
        GclError: the file is damaged, of another network, of another format, or of a run with
            other samples, groups, batch or seed.
    """
    parts: dict[str, dict[str, torch.Tensor]] = {'model': {}, 'optimizer': {}, 'average': {}}
    try:
        with safe_open(path, framework='pt') as file:
            metadata = file.metadata() or {}
            if (written := metadata.get('format')) != FORMAT:
                raise GclError(
                    f'{path} has format {written!r}, this version reads {FORMAT!r}; go on with '
                    'the version that wrote it, or remove it to start anew'
                )
            step = int(metadata['step'])
            if config is not None:
                _check_recipe(path, json.loads(metadata.get('config', '{}')), step, config)
            for name in file.keys():  # noqa: SIM118 (not a dict)
                kind, rest = name.split('.', 1)
                parts[kind][rest] = file.get_tensor(name)
        state.model.load_state_dict(parts['model'])
        if state.average:
            state.average.load_state_dict(parts['average'])
        moments = _moments(parts['optimizer'], state)
        state.optimizer.load_state_dict({**state.optimizer.state_dict(), 'state': moments})
    except GclError:
        raise
    except (SafetensorError, LookupError, TypeError, ValueError, RuntimeError) as error:
        raise GclError(
            f'{path} is damaged or holds another network; remove it to start anew ({error})'
        ) from None
    return Resumed(step, metadata.get('start_sha256', ''))


def _check_recipe(path: Path, held: dict[str, Any], step: int, config: dict[str, Any]) -> None:
    """See that a run goes on with the recipe that it began with, as far as samples follow from it.

    Losses, optimiser and number of steps may change while there are steps left.
    """
    now = json.loads(json.dumps(config))
    fixed = FIXED if step < now['steps'] else (*FIXED, 'loss', 'optimizer')
    differing = [name for name in fixed if name in held and _differs(held[name], now[name])]
    if differing:
        raise GclError(
            f'{path} is of a run with other {", ".join(differing)}; set them as they were, or '
            'take another folder to start anew'
        )


def _differs(held: Any, now: Any) -> bool:
    """Whether a value was another; what a later version added is at its default."""
    if isinstance(held, dict) and isinstance(now, dict):
        return any(key not in now or _differs(value, now[key]) for key, value in held.items())
    return bool(held != now)


def _moments(tensors: dict[str, torch.Tensor], state: State) -> dict[int, dict[str, torch.Tensor]]:
    """State of the optimiser by parameter; torch itself does not look at the shapes."""
    named = dict(state.model.named_parameters())
    held = [p for group in state.optimizer.param_groups for p in group['params']]
    place = {parameter: index for index, parameter in enumerate(held)}
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for path, tensor in tensors.items():
        name, key = path.rsplit('.', 1)
        if tensor.dim() and tensor.shape != named[name].shape:
            raise ValueError(f'optimizer.{path} has shape {tuple(tensor.shape)}')
        moments.setdefault(place[named[name]], {})[key] = tensor
    return moments
