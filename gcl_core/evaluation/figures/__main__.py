"""`python -m gcl_core.evaluation.figures`: draw one figure."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from gcl_core.data.formats import open_sequences
from gcl_core.data.sequence import Sequence
from gcl_core.data.simulator.sequence import SimulatedSequence
from gcl_core.errors import GclError, bad_input_exits
from gcl_core.evaluation.figures import OF_FEATURES, OF_POSITIVES, FigureResult, compare
from gcl_core.files import check_writable, write_text
from gcl_core.registrar import Registrar, RegistrarConfig


def main(arguments: list[str] | None = None) -> None:
    """Parse, draw, write."""
    parser = argparse.ArgumentParser(prog='figures', description='Draw a figure of the paper.')
    parser.add_argument('figure', choices=sorted(OF_POSITIVES | OF_FEATURES))
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument('--data', type=Path, help='data set, bag, or folder of clouds')
    source.add_argument(
        '--simulated', type=int, nargs='+', metavar='SEED', help='simulated drives'
    )
    parser.add_argument('--sequence', nargs='+', help='names of drives; default: the only one')
    parser.add_argument('--weights', default=RegistrarConfig().weights, help='name or file')
    parser.add_argument(
        '--baseline', default='', help='pair-wise weights to draw beside in drift and inliers'
    )
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, required=True, help='SVG; its numbers go to .json')
    with bad_input_exits('figures'):
        found = draw(parser.parse_args(arguments))
    print(f'{found.caption}\npublished: {found.published}')


def draw(options: argparse.Namespace) -> FigureResult:
    """Draw the figure and write it, its numbers beside it.

    Raises:
        GclError: bad weights or data, a figure without a baseline, or no way to write.
    """
    name, seed, baseline = options.figure, options.seed, options.baseline
    check_writable(options.out)
    if name in OF_POSITIVES:
        if baseline:
            raise GclError(f'{name} describes no scan; leave --baseline out')
        found = OF_POSITIVES[name](_open(options), seed=seed)
    else:
        weights = {'GCL-ROS': options.weights} | ({'pair-wise': baseline} if baseline else {})
        registrars = {k: Registrar(RegistrarConfig(weights=w)) for k, w in weights.items()}
        found = OF_FEATURES[name](compare(registrars, _open(options), seed=seed))
    rows = {'caption': found.caption, 'published': found.published, 'rows': found.rows}
    write_text(options.out, found.svg)
    write_text(options.out.with_suffix('.json'), json.dumps(rows, indent=2) + '\n')
    return found


def _open(options: argparse.Namespace) -> dict[str, Sequence]:
    if options.data:
        return open_sequences(options.data, options.sequence)
    return {str(seed): SimulatedSequence(seed) for seed in options.simulated}


if __name__ == '__main__':
    main()
