"""Whether the middleware will carry clouds: said at start, not found out by silence."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

PROFILE_KEYS = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
SCAN = 1_920_000  # bytes of one 64-beam scan of 120,000 points with intensity
SEGMENT = re.compile(r'<segment_size>\s*(\d+)\s*</segment_size>')


def unprotected() -> str | None:
    """What to say of DDS security that was asked for but is not enforced; None otherwise."""
    wanted = os.environ.get('ROS_SECURITY_ENABLE', '').lower() == 'true'
    if not wanted or os.environ.get('ROS_SECURITY_STRATEGY', '') == 'Enforce':
        return None
    return (
        'ROS_SECURITY_STRATEGY is not Enforce: where no keys are found for this node, it runs '
        'unprotected; set ROS_SECURITY_STRATEGY=Enforce'
    )


def warning(
    rmw: str, *, reliable: bool, environment: Mapping[str, str] = os.environ
) -> str | None:
    """What to say about big clouds at start; None when they will arrive.

    Fast DDS's shared-memory segment of 512 kB loses best-effort clouds of 120,000 points: 1 of
    50 to 100 arrives (measured over loopback at 10 Hz); reliable ones all do.

    Args:
        rmw: identifier of the middleware, such as `rmw_fastrtps_cpp`.
        reliable: whether the subscriptions are.
        environment: of the process.
    """
    if (
        reliable
        or 'fastrtps' not in rmw
        or 'LARGE_DATA' in environment.get('FASTDDS_BUILTIN_TRANSPORTS', '')
    ):
        return None
    remedy = (
        'set it to config/fastdds.xml of this package for publishers and node, or reliable:=true'
    )
    path = next((environment[key] for key in PROFILE_KEYS if environment.get(key)), '')
    if not path:
        return (
            'Fast DDS loses best-effort clouds over 512 kB with its default transport; '
            f'FASTDDS_DEFAULT_PROFILES_FILE is not set: {remedy}'
        )
    try:
        sizes = SEGMENT.findall(Path(path).read_text())
    except (OSError, UnicodeDecodeError):
        return f'the Fast DDS profile {path} cannot be read: {remedy}'
    if sizes and int(sizes[0]) < SCAN:
        return (
            f'the Fast DDS profile {path} has a shared-memory segment of {int(sizes[0])} bytes, '
            f'a scan may have {SCAN}: {remedy}'
        )
    return None
