"""The methods of a benchmark, made ready to run: ours, peers, estimators x features."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from gcl_core.errors import GclError
from gcl_core.evaluation.benchmark import Estimators, MethodConfig, Ours
from gcl_core.evaluation.compare import Comparison
from gcl_core.evaluation.peers import PEERS
from gcl_core.evaluation.predict import Contestant, Method, Outcome, timed
from gcl_core.models import zoo
from gcl_core.registrar import Registrar
from gcl_core.types import PointCloud


def ready(method: MethodConfig) -> Contestant:
    """Load what a method needs.

    Raises:
        GclError: its weights or its package are missing.
    """
    if isinstance(method, Ours):
        return OursTimed(method.labels, registrar(method))
    if isinstance(method, Estimators):
        return Comparison(Registrar(method.registrar), method.names, method.features)
    return partial(_peer, method.name, PEERS[method.name]())


def _peer(name: str, method: Method, source: PointCloud, target: PointCloud) -> Iterator[Outcome]:
    yield timed(name, method, source, target)


def registrar(method: Ours) -> Registrar:
    """Make the registrar of one of our methods."""
    check_weights(method)
    made = Registrar(method.registrar)
    if method.voxel_size is not None:
        trained = made.model
        made.model = zoo.build(replace(trained.config, voxel_size=method.voxel_size)).eval()
        made.model.load_state_dict(trained.state_dict())
        made.model.dtype = trained.dtype
    return made


def check_weights(method: MethodConfig) -> None:
    """See that weights exist, before hours are spent on other methods.

    Raises:
        GclError: a file is missing; the message has the command that makes it.
    """
    if not isinstance(method, Ours):
        return
    path = Path(method.registrar.weights)
    if path.suffix == '.safetensors' and method.trained_by and not path.is_file():
        raise GclError(
            f'{method.name}: no weights {path}; make them with '
            f'`gcl train --config {method.trained_by} --out {path.parent}`'
        )


@dataclass
class OursTimed:
    """Registers with our registrar, stage by stage; a `predict.Contestant`.

    The stages are the registrar's, but for `describe`, which is told apart into `data` (voxels,
    their neighbours, surfaces for the checks) and `features` (the network).

    Attributes:
        labels: name in results of each kind of answer that is given, see `Ours.give`.
        registrar: of ours.
    """

    labels: dict[str, str]
    registrar: Registrar

    def __call__(self, source: PointCloud, target: PointCloud) -> Iterator[Outcome]:
        """Register once; yield each kind of answer."""
        watch = _NetworkWatch()
        model = self.registrar.model
        hooks = [
            model.register_forward_pre_hook(watch.begin),
            model.register_forward_hook(watch.end),
        ]
        try:
            began = time.perf_counter()
            result = self.registrar.register(source=source, target=target)
            seconds = time.perf_counter() - began
        finally:
            for hook in hooks:
                hook.remove()
        ms = dict(result.ms)
        described = ms.pop('describe', 0.0)
        ms = {'data': round(described - watch.ms, 1), 'features': round(watch.ms, 1), **ms}
        for kind, name in self.labels.items():
            given = result.accepted or kind == 'best'
            yield Outcome(name, result.T_target_source if given else None, seconds, ms)


class _NetworkWatch:
    """Adds up the milliseconds during which a network runs, for one scan or for two at a time."""

    def __init__(self) -> None:
        self.ms = 0.0
        self._lock, self._running, self._began = threading.Lock(), 0, 0.0

    def begin(self, *_: Any) -> None:
        """Start, before a forward pass."""
        with self._lock:
            if self._running == 0:
                self._began = time.perf_counter()
            self._running += 1

    def end(self, *_: Any) -> None:
        """Stop, after a forward pass."""
        with self._lock:
            self._running -= 1
            if self._running == 0:
                self.ms += 1e3 * (time.perf_counter() - self._began)
