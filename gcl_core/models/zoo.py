"""Shipped and own weights: safetensors whose metadata say what they are."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from gcl_core.config import from_mapping, read_json
from gcl_core.errors import GclError
from gcl_core.files import sha256, whole_file, write_text
from gcl_core.models.backbone import Backbone
from gcl_core.models.kpconv_resunet import KPConvConfig, KPConvResUNet
from gcl_core.models.resunet import ResUNet, ResUNetConfig
from gcl_core.ops.precision import best_dtype

FOLDER = Path(__file__).parent / 'weights'
DEFAULT = 'gcl_conv'
SHIPPED = f'{DEFAULT}.calibration.json'
FORMAT = 'gcl-resunet-1'

NetworkConfig = ResUNetConfig | KPConvConfig  # told apart by `backbone`; `conv` if it is left out


@dataclass(frozen=True)
class _Record:
    """What a weights file says of its network."""

    network: NetworkConfig


def build(config: NetworkConfig) -> Backbone[Any, Any]:
    """Make the network of a config, with new weights."""
    return ResUNet(config) if isinstance(config, ResUNetConfig) else KPConvResUNet(config)


def save_weights(path: Path, model: Backbone[Any, Any], record: dict[str, Any]) -> None:
    """Write weights in float32 with the network's config, and `record` beside them as JSON.

    Args:
        path: ends in `.safetensors`.
        model: trained network.
        record: recipe, seed, measured recall: whatever tells where the weights come from.
    """
    tensors = {name: t.contiguous() for name, t in model.state_dict().items()}
    network = json.dumps(asdict(model.config))
    with whole_file(path) as part:
        save_file(tensors, part, metadata={'format': FORMAT, 'network': network})
        card = {'sha256': sha256(part), 'network': asdict(model.config), **record}
        write_text(path.with_suffix('.json'), json.dumps(card, indent=2) + '\n')


def weights_file(name_or_path: str) -> Path:
    """Where weights lie: a shipped name or a `.safetensors` file."""
    path = Path(name_or_path)
    return path if path.suffix == '.safetensors' else FOLDER / f'{name_or_path}.safetensors'


def own_calibration(weights: str) -> Path:
    """Where the calibration of weights belongs: beside them."""
    return weights_file(weights).with_suffix('.calibration.json')


def calibration_file(weights: str) -> Path:
    """Where the calibration of weights lies; the shipped one for those without."""
    own = own_calibration(weights)
    return own if own.is_file() else FOLDER / SHIPPED


def load_weights(name_or_path: str = DEFAULT) -> Backbone[Any, Any]:
    """Load a shipped name or a `.safetensors` file, ready to describe scans.

    Raises:
        GclError: no such weights, a broken file, or one of another format.
    """
    path = weights_file(name_or_path)
    if not path.is_file():
        shipped = ', '.join(sorted(p.stem for p in FOLDER.glob('*.safetensors'))) or 'none'
        raise GclError(f'no weights {name_or_path!r}; shipped are: {shipped}, or give a file')
    _check_hash(path)
    try:
        with safe_open(path, framework='pt') as file:
            metadata = file.metadata() or {}
            if metadata.get('format') != FORMAT:
                raise GclError(
                    f'{path} has format {metadata.get("format")!r}, this version reads '
                    f'{FORMAT!r}; train anew with `gcl train`, or take the version that wrote it'
                )
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise GclError(f'{path} is not a safetensors file: {error}') from None
    try:
        network = {'network': json.loads(metadata.get('network', ''))}
    except (ValueError, RecursionError) as error:
        raise GclError(f'{path} does not tell its network: {error}; train anew') from None
    config = from_mapping(_Record, network, str(path)).network
    _check_tensors(config, tensors, path)
    model = build(config)
    model.load_state_dict(tensors)
    return model.eval()


def _check_tensors(config: NetworkConfig, tensors: dict[str, torch.Tensor], path: Path) -> None:
    """Check that a file has every weight of a network before memory is taken for it."""
    try:
        with torch.device('meta'):
            build(config).load_state_dict(tensors, assign=True)
    except (RuntimeError, TypeError, ArithmeticError) as error:
        raise GclError(f'{path}: weights and network do not fit: {error}') from None
    for name, tensor in tensors.items():
        if not tensor.isfinite().all():
            raise GclError(f'{path}: {name} is not finite; restore the file or train anew')


def _check_hash(path: Path) -> None:
    card = path.with_suffix('.json')
    if not card.is_file():
        return
    record = read_json(card, 'restore it, or remove it')
    expected = record.get('sha256') if isinstance(record, dict) else None
    found = sha256(path)
    if expected != found:
        raise GclError(
            f'{path} has sha256 {found[:12]}…, its record says {str(expected)[:12]}…; '
            'the file is damaged or replaced: restore it, or remove the record'
        )


def dtype_named(precision: str) -> torch.dtype:
    """Dtype of `auto`, `bfloat16` or `float32`.

    Raises:
        GclError: another name.
    """
    names = {'auto': best_dtype(), 'bfloat16': torch.bfloat16, 'float32': torch.float32}
    if precision not in names:
        raise GclError(f'precision is {precision!r}; choose one of {", ".join(names)}')
    return names[precision]


def device_named(device: str) -> torch.device:
    """Device of `auto`, `cpu` or `cuda`.

    Raises:
        GclError: another name, or a GPU where torch finds none.
    """
    found = torch.cuda.is_available()
    if device not in ('auto', 'cpu', 'cuda'):
        raise GclError(f'device is {device!r}; choose auto, cpu or cuda')
    if device == 'cuda' and not found:
        raise GclError('device is cuda, but torch finds no GPU; take auto or cpu')
    return torch.device('cuda' if found and device != 'cpu' else 'cpu')
