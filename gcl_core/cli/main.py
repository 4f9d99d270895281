"""`gcl`: register two scans, train, evaluate, list pairs, simulate, inspect, pack, make bags."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from importlib import import_module

import gcl_core
from gcl_core.cli.outcome import Answer, loading, run_command, say
from gcl_core.cli.parsers import (
    bag,
    evaluate,
    inspect,
    pack,
    pairs,
    register,
    simulate,
    train,
    unpack,
)
from gcl_core.cli.parsers.form import form, parsed

COMMANDS = (register, train, evaluate, pairs, simulate, inspect, pack, unpack, bag)


def parser() -> argparse.ArgumentParser:
    """Everything that `gcl` takes."""
    made = argparse.ArgumentParser(
        prog='gcl',
        **form(
            'Distant registration of LiDAR scans with density-invariant features.',
            [
                'gcl inspect --simulated 7 --pair 120 100 --picture pair.png',
                'gcl evaluate --simulated 7 --per-bin 2',
                'gcl COMMAND --help',
            ],
        ),
    )
    made.add_argument('--version', action='version', version=f'gcl {gcl_core.__version__}')
    commands = made.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for command in COMMANDS:
        command.add_parser(commands)
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; returns an exit code, see `parsers.form.EXIT_CODES`."""
    return run_command('gcl', lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    options = parsed(parser(), arguments)
    return run_command(f'gcl {options.command}', lambda: say(lambda: _answer(options)))


def _answer(options: argparse.Namespace) -> Answer:
    """What the command's module says; loaded only now, since torch and Open3D take seconds."""
    run: Callable[[argparse.Namespace], Answer]
    with loading():
        run = import_module(f'gcl_core.cli.{options.command}').run
    return run(options)


if __name__ == '__main__':
    sys.exit(main())
