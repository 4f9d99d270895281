"""How old transforms are where the source's scans come over a radio channel, and where not."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from gcl_core.errors import GclError
from gcl_ros.bench_channel import Channel, Conditions
from gcl_ros.transport import PROFILE_KEYS


def environment() -> dict[str, str]:
    """Of programs that talk over UDP, from one station to another."""
    found = {key: value for key, value in os.environ.items() if key not in PROFILE_KEYS}
    found |= {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    return found


def ages(air: Conditions, minutes: float, folder: Path) -> dict[str, Any]:
    """Run `gcl_ros.bench_age` with its source in the same station and in another.

    Both times the source sends compact scans and the target, beside the registrar, raw ones.

    Args:
        air: conditions between the stations.
        minutes: of streaming, each time.
        folder: for scans and logs.

    Raises:
        GclError: no channel can be made here, or a run failed.
    """
    found = {}
    for name in ('loopback', 'channel'):
        with Channel(2, air) as channel:
            command = [sys.executable, '-m', 'gcl_ros.bench_age', '--compact']
            command += ['--minutes', str(minutes), '--out', str(folder)]
            if name == 'channel':
                command += ['--source-in', channel.names[1]]
            if channel.start(0, command, env=environment(), stdout=sys.stderr).wait() != 0:
                raise GclError(f'bench_age failed; see what it said, and the logs in {folder}')
            result = json.loads((folder / 'age.json').read_text())
        keys = ('transforms', 'wrong', 'age_s', 'transforms_per_s', 'clouds without partner')
        found[name] = {key: result[key] for key in keys}
    found['mbit'] = air.mbit
    return found
