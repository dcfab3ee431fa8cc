"""Reading and writing whole files, with one clear line where that fails."""

from pathlib import Path

from cruise.errors import CruiseError
from cruise.files import write_whole


def write_atomically(path: Path | str, data: bytes) -> None:
    """Write a file whole or not at all, and its folder if need be. Raises CruiseError where that fails."""
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)
    except (OSError, ValueError) as error:
        raise CruiseError(f"cannot write {path}: {_reason(error)}") from error


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
