"""`gcl unpack`: a packed scan as points that other programs read."""

from __future__ import annotations

import argparse

from gcl_core.cli.outcome import Answer
from gcl_core.data.clouds import read_cloud, writable_format, write_cloud
from gcl_core.data.packing import SUFFIX
from gcl_core.errors import GclError
from gcl_core.files import check_writable


def run(options: argparse.Namespace) -> Answer:
    """Read, and write."""
    scan, out = options.scan, options.out
    if scan.suffix.lower() != SUFFIX:
        raise GclError(f'{scan} is no packed scan: its name does not end in {SUFFIX}')
    if writable_format(out) == SUFFIX:
        raise GclError(f'{out} would be packed again; name a .pcd, .ply, .npy or .bin')
    check_writable(out)
    cloud = read_cloud(scan)
    write_cloud(out, cloud)
    return Answer(f'{out}: {len(cloud):,} points')
