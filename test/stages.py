"""Register two scans with several numbers of threads, and print a digest of what each stage made.

    python test/stages.py FOLDER WEIGHTS PRECISION THREADS...

The folder holds source.npy and target.npy. Without compiled kernels the network and the search in
feature space are torch's: they are done once, with one thread, and what follows is compared.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gcl_core.data.clouds import read_cloud
from gcl_core.estimation.decision import examine, summary
from gcl_core.estimation.estimators import EstimatorConfig, estimate
from gcl_core.matching.match import match
from gcl_core.ops.native.build import library
from gcl_core.registrar import Registrar, RegistrarConfig
from gcl_core.types import PointCloud
from gcl_core.view import View


def digest(value: Any) -> str:
    """Of every bit of arrays, tensors, numbers, and of what holds them."""
    if isinstance(value, torch.Tensor):
        value = value.numpy()
    if isinstance(value, np.ndarray):
        content = value.tobytes()
    elif is_dataclass(value):
        # Times differ from run to run.
        content = ''.join(digest(getattr(value, f.name)) for f in fields(value) if f.name != 'ms')
        content = content.encode()
    elif isinstance(value, list | tuple):
        content = ''.join(map(digest, value)).encode()
    else:
        content = repr(value).encode()
    return hashlib.sha256(content).hexdigest()


def view_stages(registrar: Registrar, side: str, cloud: PointCloud) -> Iterator[tuple[str, Any]]:
    view = registrar.view(cloud)
    for field in fields(view):
        yield f'{side}: {field.name}', getattr(view, field.name)


def pair_stages(
    registrar: Registrar, source: View, target: View, matches: Any = None
) -> Iterator[tuple[str, Any]]:
    config = registrar.config
    if matches is None:
        features = {'source': source.features, 'target': target.features}
        matches = match(**features, config=config.match)
    yield 'matches', matches
    for estimator in (EstimatorConfig(), EstimatorConfig(name='spatial_consistency')):
        hypotheses = estimate(matches, estimator)
        yield f'hypotheses of {estimator.name}', hypotheses
    scene = registrar.scene(source=source, target=target)
    yield 'scene', scene
    examined = examine(hypotheses, scene, config.verify)
    yield 'evidence', examined
    calibration = registrar.calibration
    odds = calibration.estimated.choice.log_odds(examined)
    yield 'odds', odds
    finalists = registrar.finalists(hypotheses, odds, scene, source=source, target=target)
    yield 'finalists', finalists
    yield 'summary', summary(finalists, examined, calibration)[1]


def main() -> None:
    folder, weights, precision, *threads = sys.argv[1:]
    source, target = (read_cloud(Path(folder) / f'{side}.npy') for side in ('source', 'target'))
    registrar = Registrar(RegistrarConfig(weights=weights, precision=precision, headings=1))
    compiled, matches = library() is not None, None
    torch.set_num_threads(1)
    views = [registrar.view(cloud) for cloud in (source, target)]
    if not compiled:
        seen = {'source': views[0].features, 'target': views[1].features}
        matches = match(**seen, config=registrar.config.match)
    runs = []
    for count in map(int, threads):
        torch.set_num_threads(count)
        made = list(pair_stages(registrar, *views, matches))
        if compiled:
            made += view_stages(registrar, 'source', source)
            made += view_stages(registrar, 'target', target)
            made.append(('registration', registrar.register(source=source, target=target)))
        runs.append({name: digest(value) for name, value in made})
    T = registrar.register(source=source, target=target).T_target_source
    print(json.dumps({'runs': runs, 'T': None if T is None else T.tolist()}))


if __name__ == '__main__':
    main()
