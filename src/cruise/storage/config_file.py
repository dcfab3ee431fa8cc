"""Frozen dataclasses as JSON and back, strictly: every key known, every value of its type."""

import json
import math
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_origin

import cattrs

from cruise.config import Vehicle
from cruise.errors import CruiseError
from cruise.storage.atomic import read_bytes, write_atomically

T = TypeVar("T")


def save_config(path: Path | str, config: Any) -> None:
    """Write a dataclass as JSON, whole or not at all."""
    write_atomically(path, to_json(config).encode())


def load_config(path: Path | str, kind: type[T], what: str = "configuration") -> T:
    """Read a dataclass of type `kind`. Raises CruiseError, naming the offending key, where the file does not fit."""
    return from_json(read_bytes(path, what), kind, f"{what} {path}")


def to_data(config: Any) -> dict[str, Any]:
    """A dataclass as nested dictionaries, lists and plain values; infinities become the strings "inf" and "-inf"."""
    return _CONVERTER.unstructure(config)


def to_json(config: Any) -> str:
    """JSON text of a dataclass; see `to_data`."""
    return json.dumps(to_data(config), indent=2, allow_nan=False) + "\n"


def from_json(text: bytes | str, kind: type[T], where: str) -> T:
    """A dataclass of type `kind` from JSON. `where` begins the message of the CruiseError that bad input raises."""
    data = parse_json(text, where)
    if not isinstance(data, dict):
        raise CruiseError(f"{where}: expected a JSON object, got {_show(data)}")
    return from_data(data, kind, where)


def from_data(data: dict[str, Any], kind: type[T], where: str) -> T:
    """A dataclass of type `kind` from nested dictionaries; see `from_json`."""
    try:
        return _CONVERTER.structure(data, kind)
    except cattrs.BaseValidationError as error:
        faults = cattrs.transform_error(error, path="", format_exception=_explain)
        raise CruiseError(f"{where}: {_tidy(faults[0])}") from None


def parse_json(text: bytes | str, where: str) -> Any:
    """JSON by the letter: no NaN, no key twice. Raises CruiseError with the line of the fault."""

    def no_constant(name: str) -> None:
        raise ValueError(f"{name} is not a number of JSON")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            raise ValueError(f"key {twice!r} occurs twice")
        return dict(pairs)

    try:
        return json.loads(text, parse_constant=no_constant, object_pairs_hook=unique)
    except json.JSONDecodeError as error:
        raise CruiseError(f"{where}: not valid JSON (line {error.lineno}, column {error.colno}: {error.msg})") from None
    except (ValueError, RecursionError) as error:
        raise CruiseError(f"{where}: not valid JSON ({error})") from None


def _show(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _integer(value: Any, _: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"expected an integer, got {_show(value)}")
    return value


def _number(value: Any, _: Any) -> float:
    if value in ("inf", "-inf"):
        return float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError(f"expected a number, got {_show(value)}")
    return float(value)


def _text(value: Any, _: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"expected a string, got {_show(value)}")
    return value


def _flag(value: Any, _: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"expected true or false, got {_show(value)}")
    return value


def _named_or_whole(converter: cattrs.Converter, value: Any) -> str | Vehicle:
    """A vehicle by the name of its preset, or by all of its numbers."""
    if not isinstance(value, str | dict):
        raise TypeError(f"expected a vehicle's name or its numbers, got {_show(value)}")
    return value if isinstance(value, str) else converter.structure(value, Vehicle)


def _plain_number(value: float) -> float | str:
    return str(value) if math.isinf(value) else value


def _explain(error: BaseException, kind: Any) -> str:
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        return "unknown key " + ", ".join(repr(key) for key in sorted(error.extra_fields))
    if isinstance(error, KeyError):
        return "missing"
    if isinstance(error, TypeError) and str(error).startswith("expected"):
        return str(error)
    choices = getattr(kind, "__args__", None)
    if choices and all(isinstance(choice, str) for choice in choices):
        return f"expected one of {', '.join(choices)}"
    if isinstance(error, ValueError) and " values in " in str(error):
        return "wrong number of values"
    if is_dataclass(kind):
        return "expected an object"
    return "expected a list" if kind is tuple or get_origin(kind) is tuple else "invalid value"


def _tidy(fault: str) -> str:
    """Give `ppo.epochs: expected an integer` for `expected an integer @ .ppo.epochs`."""
    message, _, path = fault.rpartition(" @ ")
    path = path.lstrip(".")
    return f"{path}: {message}" if path else message


def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True)
    for kind, hook in ((int, _integer), (float, _number), (str, _text), (bool, _flag)):
        converter.register_structure_hook(kind, hook)
    converter.register_unstructure_hook(float, _plain_number)
    converter.register_structure_hook(str | Vehicle, lambda value, _: _named_or_whole(converter, value))
    return converter


_CONVERTER = _converter()
