"""Whether the middleware will carry clouds: set up, or said at start, not found out by silence."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import rclpy

from gcl_core.errors import GclError

FASTDDS, FASTRTPS = 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE'
PROFILE_KEYS = (FASTDDS, FASTRTPS)
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS'
# What Fast DDS reads, by its library: 3 (Kilted), which takes the profile's old name too and calls
# it deprecated; 2.6 (Humble); 2.14 (Jazzy). The transports came with 2.13.
READS = {
    'libfastdds.so': (*PROFILE_KEYS, TRANSPORTS),
    'libfastrtps.so.2.6': (FASTRTPS,),
    'libfastrtps.so': (FASTRTPS, TRANSPORTS),
}
FOLDERS = Path(__file__).resolve().parents
PLACES = FOLDERS[1], *(folder / 'share/gcl_ros' for folder in FOLDERS)  # a checkout; a prefix
PROFILE = next((p for place in PLACES if (p := place / 'config/fastdds.xml').is_file()), None)
SCAN = 1_920_000  # bytes of one 64-beam scan of 120,000 points with intensity
SEGMENT = re.compile(r'<segment_size>\s*(\d+)\s*</segment_size>')


def keep_local() -> None:
    """Let this process and its children talk on this machine only, big clouds included."""
    given = next((path for key in PROFILE_KEYS if (path := os.environ.get(key))), PROFILE)
    keys = read_here()
    if given is None:
        raise GclError(f'config/fastdds.xml was not installed; set {keys[0]} to a copy')
    if not any(os.environ.get(key) for key in keys if key in PROFILE_KEYS):
        os.environ[keys[0]] = str(given)
    if os.environ.get('ROS_DISTRO') == 'humble':
        os.environ.setdefault('ROS_LOCALHOST_ONLY', '1')
    else:  # which warn of the older variable
        os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def unprotected() -> str | None:
    """What to say of DDS security that was asked for but is not enforced; None otherwise."""
    wanted = os.environ.get('ROS_SECURITY_ENABLE', '').lower() == 'true'
    if not wanted or os.environ.get('ROS_SECURITY_STRATEGY', '') == 'Enforce':
        return None
    return (
        'ROS_SECURITY_STRATEGY is not Enforce: where no keys are found for this node, it runs '
        'unprotected; set ROS_SECURITY_STRATEGY=Enforce'
    )


def read_here(loaded: str | None = None) -> tuple[str, ...]:
    """Names of the variables that Fast DDS reads here, first that of its profile.

    Args:
        loaded: names of libraries; by default those of this process, as Linux tells them.
    """
    if loaded is None:
        rclpy.get_rmw_implementation_identifier()  # loads the middleware
        maps = Path('/proc/self/maps')
        loaded = maps.read_text() if maps.exists() else ''
    newest = READS['libfastdds.so']
    return next((names for library, names in READS.items() if library in loaded), newest)


def warning(
    rmw: str, *, reliable: bool, read: Sequence[str], environment: Mapping[str, str] = os.environ
) -> str | None:
    """What to say about big clouds at start; None when they will arrive.

    Fast DDS's shared-memory segment of 512 kB loses best-effort clouds of 120,000 points: 1 of
    50 to 100 arrives (measured over loopback at 10 Hz); reliable ones all do.

    Args:
        rmw: identifier of the middleware, such as `rmw_fastrtps_cpp`.
        reliable: whether the subscriptions are.
        read: variables that Fast DDS reads, see `read_here`.
        environment: of the process.
    """
    given = {name: value for name in read if (value := environment.get(name))}
    if reliable or 'fastrtps' not in rmw or 'LARGE_DATA' in given.get(TRANSPORTS, ''):
        return None
    remedy = (
        'set it to config/fastdds.xml of this package for publishers and node, or reliable:=true'
    )
    path = next((given[key] for key in PROFILE_KEYS if key in given), '')
    if not path:
        other = next((key for key in PROFILE_KEYS if environment.get(key)), None)
        unread = f' ({other} is, which this version does not read)' if other else ''
        return (
            'Fast DDS loses best-effort clouds over 512 kB with its default transport; '
            f'{read[0]} is not set{unread}: {remedy}'
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
