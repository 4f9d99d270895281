"""Files that are whole or not there."""

from __future__ import annotations

import hashlib
import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from safetensors import SafetensorError

from gcl_core.errors import GclError, reason_of


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path beside `path` to write to; the file takes its place once it is written.

    Raises:
        GclError: it cannot be written, for lack of room for instance; what was there before is
            still there.
    """
    part = path.with_name(f'.{os.getpid()}_{path.name}')  # keeps the suffix
    try:
        part.touch()
        mode = part.stat().st_mode
        yield part
        part.chmod(mode)  # safetensors' would be readable by its owner alone
        part.replace(path)
    except (OSError, SafetensorError) as error:
        raise GclError(
            f'cannot write {path}: {reason_of(error)}; '
            'check its folder and the room left on the disk'
        ) from None
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Give a folder-to-be beside `path`; what is made there takes its place once it is whole.

    Raises:
        GclError: something is there already, or it cannot be written.
    """
    check_new(path)
    try:
        with tempfile.TemporaryDirectory(prefix='.unfinished_', dir=path.parent) as folder:
            part = Path(folder) / path.name
            yield part
            part.rename(path)
    except (OSError, sqlite3.Error) as error:
        raise GclError(
            f'cannot write {path}: {reason_of(error)}; '
            'check its folder and the room left on the disk'
        ) from None


def check_new(path: Path) -> None:
    """See that a folder can be made: before long work, not after.

    Raises:
        GclError: something is there already, or it cannot be written.
    """
    if path.exists():
        raise GclError(f'{path} exists already; remove it or choose another name')
    check_writable(path)


def check_writable(*paths: Path) -> None:
    """See that files can be written, their folders made if need be: before long work, not after.

    Raises:
        GclError: one cannot.
    """
    for path in paths:
        try:
            with suppress(FileExistsError):  # another process may make it at the same moment
                path.parent.mkdir(parents=True)
            with tempfile.TemporaryFile(dir=path.parent):
                pass
        except OSError as error:
            raise GclError(f'cannot write {path}: {reason_of(error)}') from None
        if path.is_dir():
            raise GclError(f'cannot write {path}: it is a folder; name a file')


def sha256(*paths: Path) -> str:
    """SHA-256 of what the files hold, one after the other."""
    return hashlib.sha256(b''.join(path.read_bytes() for path in paths)).hexdigest()


def write_text(path: Path, text: str) -> None:
    """Write a whole text file.

    Raises:
        GclError: as `whole_file`.
    """
    with whole_file(path) as part:
        part.write_text(text)
