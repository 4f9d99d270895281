"""Fuzzes one target in this process: guided by coverage where atheris is installed.

Whatever comes out of a reader but a `GclError` ends the process with a traceback and leaves the
input in the folder; so does a crash, a hang, or memory beyond the bound.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from gcl_ros.fuzz.mutate import mutated

LONGEST = 1 << 17  # bytes of an input
INSTRUMENTED = [
    'gcl_core.compact',
    'gcl_core.data',
    'gcl_core.config',
    'gcl_core.models.zoo',
    'gcl_ros',
    'rosbags',
]
FRESH = 0.3  # share of inputs made from whole ones; the others from what libFuzzer has kept
STRUCTURED = 0.7  # share of the others by `mutate`, the rest by libFuzzer


class Run:
    """Counts what became of the inputs, and ends the process when there were enough.

    Args:
        target: reader and seeds.
        folder: for the input at hand, and what the reader writes.
        wanted: number of inputs.
        report: file that gets the counts.
    """

    def __init__(self, target: Any, folder: Path, wanted: int, report: Path) -> None:
        self._target, self._folder, self._wanted, self._report = target, folder, wanted, report
        self._counts: Counter[str] = Counter()
        self.work = folder / 'work'
        self.work.mkdir(parents=True, exist_ok=True)

    def one(self, data: bytes) -> None:
        """Feed one input."""
        from gcl_ros.fuzz.sandbox import outcome
        from gcl_ros.fuzz.targets import put

        if self._counts.total() >= self._wanted:
            self.finish()
        put(self._folder / 'last', data)
        self._counts[outcome(self._target, data, self.work)] += 1

    def finish(self) -> None:
        """Write the counts and leave."""
        used = resource.getrusage(resource.RUSAGE_SELF)
        spent = round(used.ru_utime + used.ru_stime, 1)
        content = {**self._counts, 'processor_s': spent, 'peak_mb': round(used.ru_maxrss / 1024)}
        self._report.write_text(json.dumps(content) + '\n')
        os._exit(0)


def fuzz(o: argparse.Namespace) -> None:
    """Feed seeds first, then what is made from them."""
    try:
        import atheris
    except ImportError:
        atheris = None
    if atheris is None:
        from gcl_ros.fuzz.targets import targets
    else:
        with atheris.instrument_imports(include=INSTRUMENTED):
            from gcl_ros.fuzz.targets import targets
    from gcl_ros.fuzz.sandbox import bounded_memory

    target = targets()[o.target]
    seeds = target.seeds()
    run = Run(target, o.folder, o.inputs, o.report)
    with bounded_memory():
        for data in seeds:
            run.one(data)
        if atheris is None:
            for number in range(o.inputs + 1):
                rng = np.random.default_rng([o.seed, number])
                run.one(mutated(seeds[number % len(seeds)], rng, seeds[-1]))
        else:
            _guided(atheris, run, seeds, o)


def _guided(atheris: Any, run: Run, seeds: list[bytes], o: argparse.Namespace) -> None:
    corpus = o.folder / 'corpus'
    corpus.mkdir(exist_ok=True)
    for number, data in enumerate(seeds):
        (corpus / f'seed_{number}').write_bytes(data)

    def mutator(data: bytes, max_size: int, seed: int) -> bytes:
        rng, whole = np.random.default_rng(seed), seeds[seed % len(seeds)]
        if rng.random() < FRESH:
            return mutated(whole, rng, whole)[:max_size]
        if rng.random() < STRUCTURED:
            return mutated(data, rng, whole)[:max_size]
        return bytes(atheris.Mutate(data, max_size))

    options = [f'-seed={o.seed + 1}', f'-max_len={LONGEST}', '-rss_limit_mb=0', '-timeout=300']
    options += [f'-artifact_prefix={o.folder}/', '-verbosity=0']
    atheris.Setup([sys.argv[0], *options, str(corpus)], run.one, custom_mutator=mutator)
    atheris.Fuzz()


def main() -> None:
    """Parse the command line and fuzz."""
    parser = argparse.ArgumentParser(prog='guided', description=__doc__)
    parser.add_argument('target')
    parser.add_argument('--inputs', type=int, required=True)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--folder', type=Path, required=True, help='for inputs that do harm')
    parser.add_argument('--report', type=Path, required=True, help='JSON')
    fuzz(parser.parse_args())


if __name__ == '__main__':
    main()
