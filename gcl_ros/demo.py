"""`make demo`: two vehicles meet in a simulated street, see `gcl_ros.meeting`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from gcl_core.cli.outcome import loading, run_command


def main() -> int:
    """Parse the command line and run; returns an exit code."""
    parser = argparse.ArgumentParser(prog='demo', description=__doc__)
    parser.add_argument('--out', type=Path, default=Path('build/demo'), help='bag, logs, picture')
    return run_command('demo', lambda: _run(parser.parse_args().out))


def _run(folder: Path) -> int:
    with loading():
        from gcl_ros.meeting import run

    return run(folder)


if __name__ == '__main__':
    sys.exit(main())
