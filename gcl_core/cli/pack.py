"""`gcl pack`: scans a hundredth as large, which every command reads."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from gcl_core.cli.outcome import Answer
from gcl_core.compact.scan import CompactConfig
from gcl_core.data.bin_layout import told_layout
from gcl_core.data.clouds import CloudReader
from gcl_core.data.formats import open_sequence
from gcl_core.data.packing import Packed, check_suffix, pack_drive, pack_scan
from gcl_core.errors import GclError
from gcl_core.files import check_new, check_writable
from gcl_core.to_json import to_json


def run(options: argparse.Namespace) -> Answer:
    """Pack one scan, or all of a folder."""
    packed = _drive(options) if options.scans.is_dir() else _scan(options)
    if options.json:
        return Answer(to_json({'out': options.out, **asdict(packed)}))
    what = 'a scan' if packed.scans == 1 else f'{packed.scans} scans'
    poses = ', with poses' if packed.poses else ''
    return Answer(
        f'{options.out}: {what}, {packed.voxels:,} voxels, {packed.after:,} bytes instead of '
        f'{packed.before:,}: 1/{packed.before / packed.after:.0f}{poses}'
    )


def compact_config(options: argparse.Namespace) -> CompactConfig:
    """What `parsers.pack.add_compact` took."""
    return CompactConfig(options.voxel_size, options.max_range, options.residual_bits)


def _scan(options: argparse.Namespace) -> Packed:
    for name in ('sequence', 'format'):
        if getattr(options, name):
            raise GclError(f'--{name} is of a folder; {options.scans} is none')
    check_suffix(options.out)
    check_writable(options.out)
    clouds = CloudReader(told_layout(options.columns))
    return pack_scan(options.scans, options.out, compact_config(options), clouds)


def _drive(options: argparse.Namespace) -> Packed:
    config, columns = compact_config(options), told_layout(options.columns)
    check_new(options.out)
    drive = open_sequence(options.scans, options.sequence, layout=options.format, columns=columns)
    return pack_drive(drive, options.out, config)
