"""A file that one process holds at a time."""

import contextlib
import fcntl
import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from cruise.errors import CruiseError
from cruise.storage.atomic import writing

_LOG = logging.getLogger("cruise")
_held: dict[str, IO[str]] = {}  # by this process, which may ask for them again


class Busy(CruiseError):
    """Another process is at it."""


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a file, until the block or the process ends. Raises Busy, without waiting, where another holds it."""
    with _opened(path) as file:
        _lock(file, path)
        yield


def hold(path: Path) -> None:
    """Hold a file until `release`, or until the process ends, however it does. A process may hold a file again.

    Raises:
        Busy: another process holds it.
        CruiseError: it cannot be written.
    """
    name = os.path.realpath(path)
    if name in _held and not _is_still_there(_held[name], path):
        _held.pop(name).close()
    if name not in _held:
        file = _opened(path)
        try:
            _lock(file, path)
        except Busy:
            file.close()
            raise
        _held[name] = file


def release(path: Path) -> None:
    """Let go of a file that this process holds, if it does."""
    file = _held.pop(os.path.realpath(path), None)
    if file is not None:
        file.close()


def _opened(path: Path) -> IO[str]:
    with writing(path):
        return path.open("a")


def _lock(file: IO[str], path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise Busy("another process is running it") from None
    except OSError as error:  # some network file systems hold no locks
        _LOG.warning("%s cannot be locked (%s): take care that no other process runs it", path, error.strerror)


def _is_still_there(file: IO[str], path: Path) -> bool:
    """Whether the file that was opened is the one of that name: the folder may have been made anew."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), os.stat(path))
    except OSError:
        return False
