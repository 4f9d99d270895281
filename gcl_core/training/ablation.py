"""`python -m gcl_core.training.ablation`: short runs that differ in one thing, table by table.

All describe the same number of scans in training, which takes the same time; each is judged by
`training.validation` on held-out streets. Stop and start it again as you like.
"""

from __future__ import annotations

import argparse
import json
import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from gcl_core.config import load_config, read_json
from gcl_core.data.pairs import BINS
from gcl_core.errors import GclError, bad_input_exits
from gcl_core.evaluation.metrics import wilson
from gcl_core.files import check_writable, write_text
from gcl_core.training.recipe import TrainConfig
from gcl_core.training.trainer import Trainer
from gcl_core.training.validation import HELD_OUT, PAIRS_PER_BIN, validate

CACHE_GB = 8.0  # of samples, for runs that share them


@dataclass(frozen=True)
class RunConfig:
    """One run.

    Attributes:
        name: in the table, and of its folder.
        table: which it belongs to; several where it is a row of each.
        set: what differs from the recipe, as `gcl train --set` takes it.
        after: name of an earlier run whose last weights it starts from; from scratch if empty.
    """

    name: str
    table: tuple[str, ...]
    set: tuple[str, ...] = ()
    after: str = ''


@dataclass(frozen=True)
class AblationConfig:
    """What is compared.

    Attributes:
        recipe: YAML of `TrainConfig` that all runs share, relative to this one.
        scans: that each run describes in training.
        runs: in order; one that others start from comes before them.
        set: what differs from the recipe in all of them.
    """

    recipe: str
    scans: int
    runs: tuple[RunConfig, ...]
    set: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names = [run.name for run in self.runs]
        if len({*names}) < len(names):
            raise GclError('runs: two have the same name; give each its own')
        for place, run in enumerate(self.runs):
            if run.after and run.after not in names[:place]:
                raise GclError(f'runs: {run.name} starts after {run.after!r}, which is not above')


def recipe(config: AblationConfig, run: RunConfig, base: Path, first: int) -> TrainConfig:
    """Recipe of one run, which goes on from step `first`."""
    found = load_config(TrainConfig, base / config.recipe, (*config.set, *run.set))
    scans = found.batch * (1 + (1 if found.samples.pair_stages else found.samples.phi))
    return replace(found, steps=first + config.scans // scans)


def train(config: AblationConfig, run: RunConfig, base: Path, out: Path) -> dict[str, Any]:
    """Train and validate one run, unless that is done; returns its figures."""
    folder, result = out / run.name, out / run.name / 'result.json'
    if result.is_file():
        return dict(read_json(result, 'remove it'))
    first = 0
    if run.after:
        first = int(read_json(out / run.after / 'result.json', 'remove it')['step'])
        if not (folder / 'checkpoint.safetensors').exists():
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copy(out / run.after / 'checkpoint.safetensors', folder)
    print(f'{run.name}:')
    chosen = recipe(config, run, base, first)
    trainer = Trainer(chosen, folder, cache=(out / 'samples', CACHE_GB))
    trainer.run()
    found = {'name': run.name, 'table': run.table, 'step': trainer.step, 'after': run.after}
    found |= {'steps': trainer.step - first, 'recipe': asdict(chosen)}
    found |= validate(trainer.shipped)
    write_text(result, json.dumps(found, indent=1) + '\n')
    return found


def markdown(results: list[dict[str, Any]]) -> str:
    """A table for each name of a table: right matches by distance, and recall over all pairs."""
    parts = []
    for table in dict.fromkeys(name for found in results for name in found['table']):
        head = ' | '.join(f'{lo}–{hi} m' for lo, hi in BINS)
        parts.append(f'**{table}**: right ones among mutual matches, %\n')
        parts.append(f'| run | steps | {head} | recall of the best hypothesis, % |')
        parts.append('|---' * (3 + len(BINS)) + '|')
        parts += [_row(found) for found in results if table in found['table']]
        parts.append('')
    return '\n'.join(parts)


def _row(found: dict[str, Any]) -> str:
    inliers = [100 * found[f'valid/inliers_{lo}_{hi}'] for lo, hi in BINS]
    pairs = len(HELD_OUT) * PAIRS_PER_BIN
    hits = round(sum(pairs * found[f'valid/recall_{lo}_{hi}'] for lo, hi in BINS))
    low, high = (100 * x for x in wilson(hits, pairs * len(BINS)))
    cells = ' | '.join(f'{share:.1f}' for share in inliers)
    recall = f'{100 * hits / pairs / len(BINS):.0f} ({low:.0f}–{high:.0f})'
    return f'| {found["name"]} | {found["steps"]} | {cells} | {recall} |'


def main() -> None:
    """Train what is not trained yet, print the tables, write them as Markdown and JSON."""
    parser = argparse.ArgumentParser(prog='ablation', description=__doc__)
    parser.add_argument('--config', type=Path, default=Path('config/ablation.yaml'))
    parser.add_argument('--out', type=Path, required=True, help='folder of all runs')
    options = parser.parse_args()
    with bad_input_exits('ablation'):
        config = load_config(AblationConfig, options.config)
        check_writable(options.out / 'results.json')
        results = []
        for run in config.runs:
            results.append(train(config, run, options.config.parent, options.out))
            write_text(options.out / 'results.json', json.dumps(results, indent=1) + '\n')
            write_text(options.out / 'results.md', markdown(results))
        print(markdown(results))


if __name__ == '__main__':
    main()
