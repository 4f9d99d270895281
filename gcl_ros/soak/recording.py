"""`python -m gcl_ros.soak.recording BAG OUT`: copies a bag where there is no room for it.

A limit on the size of files stands for a full disk: writing fails in the same way. What must come
of it is one `GclError`, and no bag that could be taken for a whole one.
"""

from __future__ import annotations

import argparse
import resource
import sys
from pathlib import Path

from gcl_core.errors import GclError
from gcl_ros.bag import read_encounters, write_bag

ROOM = 300_000  # bytes of a file: less than one cloud


def main() -> None:
    """Try both storages; exit code 0 if both are refused and nothing is left."""
    parser = argparse.ArgumentParser(prog='recording', description=__doc__)
    parser.add_argument('bag', type=Path)
    parser.add_argument('out', type=Path, help='folder')
    o = parser.parse_args()
    o.out.mkdir(parents=True, exist_ok=True)
    before = set(o.out.iterdir())
    scenes = list(read_encounters(o.bag))[:3]
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, resource.RLIM_INFINITY))
    for storage in ('mcap', 'sqlite3'):
        try:
            write_bag(o.out / f'recorded_{storage}', scenes, storage)  # type: ignore[arg-type]
        except GclError as error:
            print(f'{storage}: {error}')
        else:
            sys.exit(f'{storage}: written without room')
    if left := set(o.out.iterdir()) - before:
        sys.exit(f'left behind: {sorted(map(str, left))}')


if __name__ == '__main__':
    main()
