"""A file that one process holds at a time."""

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path

from cruise.errors import CruiseError


class Busy(CruiseError):
    """Another process is at it."""


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a file, until the block or the process ends. Raises Busy, without waiting, where another holds it."""
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise Busy("another process is running it") from None
        yield
