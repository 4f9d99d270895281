"""The one error this project raises for bad input, and how a program ends by it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

BAD_INPUT, INTERRUPTED = 2, 130  # exit codes; the second as shells count SIGINT


class GclError(ValueError):
    """Bad input, named together with its remedy.

    The command line turns it into exit code 2, the node into a log line; neither dies from it.
    """


def reason_of(error: Exception) -> str:
    """What the system says of a file; for other errors their text."""
    return getattr(error, 'strerror', None) or str(error)


@contextmanager
def bad_input_exits(program: str) -> Iterator[None]:
    """Say what is wrong with the input, or with a file, and exit with 2; with 130 at Ctrl-C."""
    try:
        yield
    except (GclError, OSError) as error:  # a full disk may end anything that writes
        print(f'{program}: {error}', file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
