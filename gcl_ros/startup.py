"""Starting and ending ROS, the same on every distribution from Humble to Kilted."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions, uninstall_signal_handlers

from gcl_core.errors import GclError, reason_of

LOG_DIR = 'ROS_LOG_DIR'


@contextmanager
def running_ros(
    args: Sequence[str] | None = None, *, own_handlers: bool = False
) -> Iterator[None]:
    """Start ROS in the default context and end it; Kilted alone has `with rclpy.init()`.

    Args:
        args: command line; by default that of the program.
        own_handlers: leave SIGINT and SIGTERM to the program.

    Raises:
        GclError: a ROS argument, or a file of parameters, is none; no folder takes the log.
    """
    _ensure_log_folder()
    handlers = SignalHandlerOptions.NO if own_handlers else SignalHandlerOptions.ALL
    try:
        rclpy.init(args=None if args is None else list(args), signal_handler_options=handlers)
    except RuntimeError as error:  # rcl's own; from `at` on it tells of its sources
        reason = re.sub(r', at /.*', '', str(error), flags=re.DOTALL)
        raise GclError(
            f'{reason}; ROS arguments are pairs such as -p NAME:=VALUE, and --params-file takes a '
            'file like config/registrar.yaml'
        ) from None
    try:
        yield
    finally:
        rclpy.try_shutdown()
        uninstall_signal_handlers()  # which Kilted's try_shutdown does, the others' does not


def _ensure_log_folder() -> None:
    """Let ROS log into the temporary folder where it could not log at all, and would not start."""
    folder = _log_folder()
    try:
        if folder is None:
            raise OSError('HOME is not set')
        _check_writable(folder)
        return
    except OSError as error:
        reason = f'{folder}: {reason_of(error)}' if folder else reason_of(error)
    instead = Path(tempfile.gettempdir()) / f'ros_log_{os.getuid()}'
    try:
        _check_writable(instead)
    except OSError as error:
        raise GclError(
            f'ROS cannot write its log ({reason}; {instead}: {reason_of(error)}); '
            f'set {LOG_DIR} to a folder that can be written'
        ) from None
    os.environ[LOG_DIR] = str(instead)
    print(
        f'ROS cannot write its log ({reason}); it goes to {instead}, or where {LOG_DIR} says',
        file=sys.stderr,
    )


def _log_folder() -> Path | None:
    """Where ROS writes its log, as rcl_logging_interface finds it; None without a home."""
    if given := os.environ.get(LOG_DIR):
        return Path(given).expanduser()
    if home := os.environ.get('ROS_HOME'):
        return Path(home).expanduser() / 'log'
    home = os.environ.get('HOME')  # not from the password file, which ROS does not look into
    return Path(home) / '.ros/log' if home else None


def _check_writable(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass
