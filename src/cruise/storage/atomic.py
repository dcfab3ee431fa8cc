"""Reading and writing whole files, with one clear line where that fails."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from cruise.errors import CruiseError
from cruise.files import write_whole


def write_atomically(path: Path | str, data: bytes) -> None:
    """Write a file whole or not at all, and its folder if need be. Raises CruiseError where that fails."""
    with writing(path):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)


@contextlib.contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """Within it, what fails in writing to `path` is told in one line. Raises CruiseError."""
    try:
        yield
    except CruiseError:
        raise
    except (OSError, ValueError) as error:
        raise CruiseError(f"cannot write {path}: {_reason(error)}") from error


def make_folder(path: Path) -> None:
    """Make a folder and those above it, if need be. Raises CruiseError where that fails."""
    with writing(f"{path}/"):
        path.mkdir(parents=True, exist_ok=True)


def read_bytes(path: Path | str, what: str) -> bytes:
    """The bytes of a file. Raises CruiseError, naming `what` it should have been, where it cannot be read."""
    try:
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise CruiseError(f"{what} {path} does not exist") from None
    except (OSError, ValueError) as error:
        raise CruiseError(f"cannot read {what} {path}: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)
