"""Samples on disk, so that a second run over the same ones does not cut them again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from gcl_core.files import whole_file
from gcl_core.training.sample import Sample
from gcl_core.types import SparseTensor

Voxels = Sample[SparseTensor]  # before a network prepares them: a tenth of the size


@dataclass(frozen=True)
class SampleCache:
    """A folder of samples that never grows beyond a limit.

    Attributes:
        folder: for samples of one recipe, see `folder_for`.
        limit_gb: once it is full, the samples used longest ago go.
    """

    folder: Path
    limit_gb: float

    def get(self, number: int, cut: Callable[[int], Voxels]) -> Voxels:
        """Read sample `number`, or cut and keep it; a damaged file is cut anew."""
        path = self.folder / f'{number}.safetensors'
        try:
            sample = _read(path)
            os.utime(path)
        except (OSError, SafetensorError, KeyError):
            sample = cut(number)
            self.folder.mkdir(parents=True, exist_ok=True)
            _write(path, sample)
            self._make_room()
        return sample

    def _make_room(self) -> None:
        files = []
        for file in self.folder.glob('[!.]*.safetensors'):
            with suppress(FileNotFoundError):  # another worker made room
                files.append((file.stat(), file))
        total = sum(status.st_size for status, _ in files)
        for status, file in sorted(files, key=lambda entry: entry[0].st_mtime):
            if total <= self.limit_gb * 1e9:
                return
            file.unlink(missing_ok=True)
            total -= status.st_size


def folder_for(base: Path, *parts: Any) -> Path:
    """Folder named after everything that samples depend on: dataclasses and plain values."""
    plain = [asdict(part) if hasattr(part, '__dataclass_fields__') else part for part in parts]
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
    return base / digest[:16]


def _write(path: Path, sample: Voxels) -> None:
    voxels = sample.inputs
    tensors = {
        'keys': voxels.keys,
        'points': voxels.points,
        'features': voxels.features,
        'splits': torch.tensor(voxels.splits),
        'T_centre_scan': torch.from_numpy(sample.T_centre_scan),
    }
    with whole_file(path) as part:
        save_file(tensors, part)


def _read(path: Path) -> Voxels:
    t = load_file(path)
    splits = tuple(t['splits'].tolist())
    voxels = SparseTensor(t['keys'], t['points'], t['features'], splits)
    return Sample(voxels, t['T_centre_scan'].numpy())
