"""A node as a program: its command line, and what Ctrl-C does while its libraries load."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from gcl_core.cli.outcome import loading, run_command
from gcl_core.cli.parsers.form import form, parsed

if TYPE_CHECKING:
    from gcl_ros.lifecycle import ConfiguredNode


def node_parser(
    name: str, does: str, examples: Sequence[str], *, config: str = ''
) -> argparse.ArgumentParser:
    """What a node takes: nothing but the arguments of ROS.

    Args:
        name: of the program.
        does: what it does, for its help.
        examples: lines of its help.
        config: name of the file of its parameters, where that is not its own.
    """
    description = (
        f'{does}\nRemappings and parameters follow after --ros-args; config/{config or name}.yaml '
        'explains the parameters.'
    )
    usage = f'{name} [-h] [--ros-args ...]'
    return argparse.ArgumentParser(prog=name, usage=usage, **form(description, examples))


def run_node(
    parser: argparse.ArgumentParser, load: Callable[[], Callable[[], ConfiguredNode[Any]]]
) -> int:
    """Run a node until Ctrl-C or SIGTERM; returns an exit code.

    Args:
        parser: of the command line.
        load: imports what makes the node.
    """

    def work() -> int:
        parsed(parser, own_arguments(sys.argv[1:]))
        with loading():
            from gcl_ros.lifecycle import run

            make = load()
        run(make)
        return 0

    return run_command(parser.prog, work)


def own_arguments(arguments: Sequence[str]) -> list[str]:
    """Arguments that are not ROS's: those outside of `--ros-args … --`."""
    own, of_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            of_ros = True
        elif of_ros:
            of_ros = argument != '--'
        else:
            own.append(argument)
    return own
