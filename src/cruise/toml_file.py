"""What track and vehicle files share: reading TOML, and telling each fault in one line. Plain Python: no JAX."""

import difflib
import math
import os
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, NamedTuple

from cruise.errors import CruiseError

Table = Mapping[str, Any]
Check = Callable[[object], str]  # says what is wrong with a value; "" when nothing is
StrPath = str | os.PathLike[str]

LIMIT = 10_000.0  # largest number where nothing else is said: float32 still resolves a millimetre there
MAX_BYTES = 1_000_000
SHOWN_FAULTS = 3  # how many faults an error names


class FileKind(NamedTuple):
    """What a file describes, and the names that stand for built-in ones."""

    noun: str
    builtin: Collection[str]


def number(value: object, limit: float = LIMIT) -> str:
    """Fault of a value that must be a finite number within +-`limit`."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"must be a number, got {spell(value)}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"must be finite, got {value}"
    return "" if abs(value) <= limit else f"must lie within -{limit:g} and {limit:g}, got {spell(value)}"


def positive(value: object, limit: float = LIMIT) -> str:
    """Fault of a value that must be a number above 0."""
    return number(value, limit) or ("" if value > 0 else f"must be greater than 0, got {value}")  # type: ignore[operator]


def not_negative(value: object, limit: float = LIMIT) -> str:
    """Fault of a value that must be a number of at least 0."""
    return number(value, limit) or ("" if value >= 0 else f"must be at least 0, got {value}")  # type: ignore[operator]


def whole(value: object, low: int, high: int) -> str:
    """Fault of a value that must be a whole number from `low` to `high`."""
    if isinstance(value, bool) or not isinstance(value, int):
        return f"must be a whole number, got {spell(value)}"
    return "" if low <= value <= high else f"must be {low} to {high}, got {spell(value)}"


def numbers(value: object, names: Collection[str], check: Check = number) -> str:
    """Fault of a value that must be an array of as many numbers as `names`, each of which `check` looks at."""
    count = {2: "two", 3: "three"}.get(len(names), str(len(names)))
    wanted = f"must be {count} numbers [{', '.join(names)}]"
    if not isinstance(value, list):
        return f"{wanted}, got {spell(value)}"
    if len(value) != len(names):
        return f"{wanted}, got {len(value)} of them"
    faults = ((name, check(one)) for name, one in zip(names, value, strict=True))
    return "; ".join(f"{name} {fault}" for name, fault in faults if fault)


def label(value: object) -> str:
    """Fault of a value that must be a name."""
    if not isinstance(value, str):
        return f"must be text in quotes, got {spell(value)}"
    sound = value.strip() and value.isprintable()
    return "" if sound else f"must be printable text that is not blank, got {spell(value)}"


def flag(value: object) -> str:
    """Fault of a value that must be true or false."""
    return "" if isinstance(value, bool) else f"must be true or false, got {spell(value)}"


def choice(value: object, known: Collection[str]) -> str:
    """Fault of a value that must be one of a few words."""
    return "" if isinstance(value, str) and value in known else f"must be one of {', '.join(known)}, got {spell(value)}"


def key_faults(table: Table, keys: Mapping[str, Check], required: Mapping[str, str]) -> Iterator[str]:
    """Unknown keys, missing keys and unsuitable values of one table, one text each.

    `required` says of the keys that must be there what they are.
    """
    for key in table:
        if key not in keys:
            close = difflib.get_close_matches(str(key), keys, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(keys)}"
            yield f"unknown key {spell(key)}; {hint}"
    for key, check in keys.items():
        if key not in table and key in required:
            yield f"{key} is missing: {required[key]}"
        elif key in table and (text := check(table[key])):
            yield f"{key} {text}"


def read_toml(path: StrPath, kind: FileKind) -> dict[str, Any]:
    """Parse a TOML file.

    Raises:
        CruiseError: missing, not a regular file, too large, not UTF-8 or not TOML.
    """
    text = read_text(path, kind)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise CruiseError(f"{shown(path)}: not TOML: {reason(error)}") from error


def read_text(path: StrPath, kind: FileKind) -> str:
    """The text of a file.

    Raises:
        CruiseError: missing, not a regular file, too large or not UTF-8.
    """
    try:
        if not os.path.isfile(path):
            raise CruiseError(_not_a_file(path, kind))
        with open(path, "rb") as file:
            content = file.read(MAX_BYTES + 1)
    except CruiseError:
        raise
    except (OSError, ValueError) as error:
        raise CruiseError(f"{shown(path)}: cannot be read: {reason(error)}") from error
    if len(content) > MAX_BYTES:
        raise CruiseError(f"{shown(path)}: too large for a {kind.noun} file: more than {MAX_BYTES} bytes")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CruiseError(f"{shown(path)}: not UTF-8 text: byte {error.start} cannot be read") from error


def _not_a_file(path: StrPath, kind: FileKind) -> str:
    """Why `path` is no file, or, where it looks like a name, no built-in one."""
    text, noun = os.fspath(path), kind.noun
    if os.path.isdir(path):
        return f"{shown(path)}: is a directory, not a {noun} file"
    if os.path.exists(path):
        return f"{shown(path)}: is not a regular file"
    if isinstance(path, os.PathLike) or text.endswith(".toml") or os.sep in text:
        return f"{shown(path)}: no such {noun} file"
    return f"{unknown(text, kind)}; or give a TOML file's path"


def unknown(name: str, kind: FileKind) -> str:
    """That no built-in thing has this name, and which one may be meant."""
    close = difflib.get_close_matches(name.lower().replace("_", "-"), kind.builtin, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"unknown {kind.noun} {spell(name)}: {hint}built-in {kind.noun}s: {', '.join(kind.builtin)}"


def refuse(faults: list[str], place: str, noun: str) -> None:
    """Raises CruiseError with the first of the faults, if there are any."""
    if faults:
        rest = len(faults) - SHOWN_FAULTS
        more = [f"and {rest} more (see `cruise {noun}s check`)"] if rest > 0 else []
        raise CruiseError(f"{place}: {'; '.join([*faults[:SHOWN_FAULTS], *more])}")


def shown(path: StrPath) -> str:
    """How a message shows a path."""
    text = os.fspath(path)
    return text if text and text.isprintable() else ascii(text)


def spell(value: object) -> str:
    """How a message shows a value of the file: its kind, and the value where that is short."""
    kinds = {dict: "a table", list: "an array", type(None): "nothing"}
    if type(value) in kinds:
        return kinds[type(value)]
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) > 10**15:
        return "a huge number"
    text = ascii(value) if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def reason(error: Exception) -> str:
    """What an error of the system or of the parser says, on one line."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split())
