"""`ros2 run gcl_ros evaluate_bag BAG`: recall on a bag, through the node or offline."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcl_core.cli.outcome import Answer, loading, run_command, say
from gcl_core.cli.parsers.choices import PEERS
from gcl_core.cli.parsers.form import add_json, form, parsed
from gcl_core.cli.parsers.quantities import positive


def parser() -> argparse.ArgumentParser:
    """Everything that `evaluate_bag` takes."""
    made = argparse.ArgumentParser(
        prog='evaluate_bag',
        **form(
            'Measure recall on a bag through the node, or offline: the same registrar on the\n'
            'same clouds, without DDS in between.',
            [
                'gcl bag from-simulator 7 bag_7 --distance 20 --every 20',
                'ros2 run gcl_ros evaluate_bag bag_7 --out out --offline',
            ],
        ),
    )
    made.add_argument('bag', type=Path, help='as `gcl bag` writes it')
    made.add_argument('--out', type=Path, required=True, help='for tables, pairs, logs')
    made.add_argument(
        '--peers', nargs='*', default=[], choices=PEERS, help='also run; takes longer'
    )
    add_json(made)
    node = made.add_argument_group('through the node')
    node.add_argument(
        '--rate', type=positive, default=0.2, help='bag seconds a second; default: %(default)g'
    )
    node.add_argument(
        '--set', action='append', default=[], metavar='NAME:=VALUE', help='parameter of the node'
    )
    direct = made.add_argument_group('offline')
    direct.add_argument('--offline', action='store_true', help='without DDS, as fast as it goes')
    direct.add_argument('--config', type=Path, help='YAML of RegistrarConfig')
    direct.add_argument(
        '--compact',
        type=positive,
        nargs='+',
        default=[],
        metavar='METRES',
        help='also with the source as `sender` sends it, in voxels of this size, such as 0.25',
    )
    return made


def main() -> int:
    """Parse the command line and evaluate; returns an exit code."""
    return run_command('evaluate_bag', _run)


def _run() -> int:
    options = parsed(parser())
    return say(lambda: _answer(options))


def _answer(options: argparse.Namespace) -> Answer:
    with loading():
        from gcl_ros.bag_evaluation import run  # only now: rclpy, torch and Open3D take seconds

    return Answer(run(options))


if __name__ == '__main__':
    sys.exit(main())
