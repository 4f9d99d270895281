"""How a command ends: its answer alone on stdout, errors as one line, the same exit codes."""

from __future__ import annotations

import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass

from gcl_core.errors import BAD_INPUT, INTERRUPTED, GclError

NO_READER = 141  # as shells count SIGPIPE


@dataclass(frozen=True)
class Answer:
    """What a command came to.

    Attributes:
        text: to print; nothing if empty.
        code: to exit with.
    """

    text: str = ''
    code: int = 0


def say(work: Callable[[], Answer]) -> int:
    """Print an answer, return its code; what libraries print meanwhile goes to stderr."""
    with redirect_stdout(sys.stderr):
        answer = work()
    if answer.text:
        print(answer.text)
    return answer.code


@contextmanager
def loading() -> Iterator[None]:
    """While libraries are imported, Ctrl-C ends the process at once; there is nothing to undo.

    Raised within an import, KeyboardInterrupt becomes whatever the library makes of it.
    """
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not where it is ignored
    if ours:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def run_command(name: str, work: Callable[[], int]) -> int:
    """Do the work of a command; return its exit code, or that of what went wrong.

    Args:
        name: of the command, before the line of an error.
        work: does everything, returns an exit code.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors='replace')  # a terminal may lack the degree sign
    try:
        try:
            return work()
        finally:
            _flush()
    except BrokenPipeError:
        return NO_READER
    except (GclError, OSError, ImportError) as error:
        print(f'{name}: {_told(error)}', file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED


def _flush() -> None:
    """Write what is printed; where it cannot be, nor can it at the interpreter's end."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise


def _told(error: Exception) -> str:
    """What went wrong, and what to look at where the system does not say."""
    text = str(error)
    if 'Original Traceback' in text:  # of a process that loads samples
        text = text.strip().splitlines()[-1].partition(': ')[2]
    if isinstance(error, ImportError):  # libGL for Open3D, torch where ROS's own Python runs
        return f'{text}; install what is missing, see docs/install.md'
    if not isinstance(error, OSError):
        return text
    if error.filename is not None:  # a full disk may end anything that writes
        text = f'{error.filename}: {error.strerror}'
    return f'{text}; check its folder, rights and the room left'
