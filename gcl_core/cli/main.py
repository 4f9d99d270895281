"""`gcl`: register two scans, train, evaluate, list pairs, simulate, inspect, make bags."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from gcl_core.cli import bag, evaluate, inspect, pairs, register, simulate, train
from gcl_core.errors import GclError

COMMANDS = (register, train, evaluate, pairs, simulate, inspect, bag)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand; returns 0, 1 when no transform was accepted, or 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog='gcl',
        description='Distant registration of LiDAR scans with density-invariant features.',
        epilog='Exit codes: 0 done, 1 no transform accepted, 2 bad input.',
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for command in COMMANDS:
        command.add_parser(commands)
    options = parser.parse_args(arguments)
    try:
        code: int = options.run(options)
    except (GclError, OSError) as error:  # a full disk may end anything that writes
        print(f'gcl {options.command}: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return code


if __name__ == '__main__':
    sys.exit(main())
