"""Predict once: every pair by every method, in one process or many, going on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gcl_core.data.overlap import overlap
from gcl_core.data.pair_list import ListedPair, PairList
from gcl_core.data.sequence import Sequence
from gcl_core.errors import GclError
from gcl_core.evaluation.benchmark import BenchmarkConfig, Estimators, MethodConfig, Ours
from gcl_core.evaluation.contestants import check_weights, ready
from gcl_core.evaluation.memory import weighed
from gcl_core.evaluation.plan import Drawn, Task, digest, draw, open_source, sensor, tasks
from gcl_core.evaluation.predict import (
    Contestant,
    Outcome,
    Prediction,
    TurnedPair,
    turned_pair,
)
from gcl_core.evaluation.records import from_line, mend, merged, read_lines, to_line
from gcl_core.files import sha256
from gcl_core.models import zoo
from gcl_core.progress import progress
from gcl_core.training.distributed import Processes

DECIDES = ('source', 'pairs', 'random_yaw', 'seed', 'methods', 'overlap')  # what is predicted


class Run:
    """One benchmark in one folder.

    The folder holds `run.json` (config, pairs and their hashes) and `predictions-RANK.jsonl`, to
    which each prediction is appended as it is made. A run that was killed goes on with what is
    there; more processes may take part than before.

    Args:
        config: see `BenchmarkConfig`.
        folder: of this run alone.
        own: which process of how many this is.
        provenance: machine, commit and date of the measurement; kept where a run goes on.

    Raises:
        GclError: data or weights are missing, or the folder holds another run.
    """

    def __init__(
        self,
        config: BenchmarkConfig,
        folder: Path,
        own: Processes | None = None,
        *,
        provenance: dict[str, Any] | None = None,
    ) -> None:
        self.config, self.folder, self.own = config, folder, own or Processes()
        self.provenance = provenance or {}
        for method in config.methods:
            check_weights(method)
        self.sequences: dict[str, Sequence] = open_source(config)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise GclError(f'--out {folder} must be a folder: {error.strerror}') from None
        text = self.own.gather(self._begin() if self.own.first else '')[0]
        self.drawn = _drawn(text)
        self.provenance = json.loads(text)['provenance']
        self.tasks = tasks(config, self.drawn, self.sequences)

    def _begin(self) -> str:
        """Write `run.json`, or see that the one there is of the same run; return its pairs."""
        path, decided = self.folder / 'run.json', fingerprint(self.config)
        if not path.is_file():
            drawn = draw(self.config, self.sequences)
            content: dict[str, Any] = {'config_sha256': decided, 'pairs_sha256': digest(drawn)}
            content |= {'provenance': self.provenance, 'config': asdict(self.config)}
            content |= {'pairs': [asdict(d) for d in drawn]}
            temporary = path.with_suffix('.part')
            temporary.write_text(json.dumps(content, indent=1) + '\n')
            temporary.replace(path)
            return path.read_text()
        held = json.loads(path.read_text())
        advice = 'take another --out, or remove the folder to start afresh'
        if held['config_sha256'] != decided:
            differing = _differing(held['config'], self.config)
            raise GclError(f'{self.folder} holds predictions of {differing}; {advice}')
        if all(pairs.kind != 'low_overlap' for pairs in self.config.pairs):  # slow to draw again
            found = digest(draw(self.config, self.sequences))
            if held['pairs_sha256'] != found:
                raise GclError(
                    f'{self.folder} holds predictions on pairs with the sha256 '
                    f'{held["pairs_sha256"][:12]}, these have {found[:12]}: the data or the list '
                    f'was changed; {advice}'
                )
        return path.read_text()

    def predict(self) -> list[Prediction]:
        """Run what has not been run yet; return all predictions, in the same order always."""
        done = {(p.task, p.method) for p in map(from_line, read_lines(self.folder))}
        names = self.config.estimators
        mine = [
            (task, [name for name in names if (task.number, name) not in done])
            for task in self.tasks[self.own.rank :: self.own.count]
        ]
        mine = [(task, missing) for task, missing in mine if missing]
        path = self.folder / f'predictions-{self.own.rank}.jsonl'
        mend(path)
        if mine:
            self._predict(mine, path)
        together = self.own.gather('\n'.join(read_lines(self.folder)))
        lines = (line for text in together for line in text.split('\n') if line)
        return merged(lines, names)

    def _predict(self, mine: list[tuple[Task, list[str]]], path: Path) -> None:
        needed = {name for _, missing in mine for name in missing}
        contestants = [
            (method, ready(method))
            for method in self.config.methods
            if needed & {*method.estimators}
        ]
        bar = progress(total=len(mine), unit='pair', hidden=not self.own.first)
        with path.open('a') as file, bar:
            for task, missing in mine:
                for prediction in self._pair(task, missing, contestants):
                    file.write(to_line(prediction) + '\n')
                    file.flush()
                bar.update()

    def _pair(
        self, task: Task, missing: list[str], contestants: list[tuple[MethodConfig, Contestant]]
    ) -> Iterator[Prediction]:
        sequence = self.sequences[task.sequence]
        pair = turned_pair(sequence, task.pair, task.turned)
        known = self._known(task, pair)
        for method, contestant in contestants:
            if not {*missing} & {*method.estimators}:
                continue
            outcomes = contestant(pair.source, pair.target)
            peak = float('nan')
            for _ in method.estimators:
                if task.weighed:
                    outcome, grown = weighed(partial(next, outcomes))
                    peak = float(np.fmax(peak, grown))  # a later answer may cost nothing more
                else:
                    outcome = next(outcomes)
                if outcome.method in missing:
                    yield _prediction(outcome, peak, known)

    def _known(self, task: Task, pair: TurnedPair) -> dict[str, Any]:
        """What a prediction says of its pair."""
        sequence, source = self.sequences[task.sequence], self.config.source
        seen = [sensor(source, sequence, i) for i in (task.pair.source, task.pair.target)]
        clouds = {'source': pair.source, 'target': pair.target}
        share = overlap(**clouds, T_target_source=pair.T_true) if self.config.overlap else None
        return {
            'sequence': sequence.name,
            'pair': task.pair,
            'turned': task.turned,
            'T_true': pair.T_true,
            'dataset': task.dataset,
            'task': task.number,
            'overlap': float('nan') if share is None else share,
            'sensors': ' to '.join(seen) if all(seen) else '',
        }


def _prediction(outcome: Outcome, peak: float, known: dict[str, Any]) -> Prediction:
    return Prediction(
        method=outcome.method,
        T_estimated=outcome.T_target_source,
        seconds=outcome.seconds,
        ms=outcome.ms,
        peak_mb=peak,
        **known,
    )


def fingerprint(config: BenchmarkConfig) -> str:
    """Hash of all that decides the predictions, weights and calibration among it."""
    values = asdict(config)
    weights = {
        method.registrar.weights: _content(method.registrar.weights)
        for method in config.methods
        if isinstance(method, Ours | Estimators)
    }
    decided = {**{key: values[key] for key in DECIDES}, 'weights': weights}
    return hashlib.sha256(json.dumps(decided, sort_keys=True).encode()).hexdigest()


def _content(weights: str) -> str:
    path = zoo.weights_file(weights)
    return sha256(path, zoo.calibration_file(weights)) if path.is_file() else ''


def _differing(held: dict[str, Any], config: BenchmarkConfig) -> str:
    now = json.loads(json.dumps(asdict(config)))
    keys = [key for key in DECIDES if held.get(key) != now[key]]
    return f'another config ({", ".join(keys) or "weights or calibration"} differs)'


def _drawn(text: str) -> list[Drawn]:
    """Read the pairs of a `run.json`."""
    found = []
    for row in json.loads(text)['pairs']:
        pairs = row['pairs']
        listed = tuple(ListedPair(**pair) for pair in pairs['pairs'])
        distance = tuple(pairs['distance']) if pairs['distance'] else None
        whole = PairList(pairs['name'], listed, distance, tuple(pairs['notes']))
        found.append(Drawn(row['dataset'], whole))
    return found
