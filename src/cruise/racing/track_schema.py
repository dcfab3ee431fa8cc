"""What may stand in a track file: its keys, and what each one's value must be. Plain Python: no JAX."""

import difflib
import math
import os
from collections.abc import Callable, Iterator, Mapping
from typing import Any

Table = Mapping[str, Any]
Check = Callable[[object], str]  # says what is wrong with a value; "" when nothing is

LIMIT = 10_000.0  # largest coordinate or length: float32 still resolves a millimetre there [m]
MAX_LAPS = 1000
MAX_GATES = 200


def number(value: object) -> str:
    """Fault of a value that must be a finite number within +-LIMIT."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"must be a number, got {spell(value)}"
    if isinstance(value, float) and not math.isfinite(value):
        return f"must be finite, got {value}"
    return "" if abs(value) <= LIMIT else f"must lie within -{LIMIT:g} and {LIMIT:g}, got {spell(value)}"


def positive(value: object) -> str:
    """Fault of a value that must be a number above 0."""
    return number(value) or ("" if value > 0 else f"must be greater than 0, got {value}")  # type: ignore[operator]


def not_negative(value: object) -> str:
    """Fault of a value that must be a number of at least 0."""
    return number(value) or ("" if value >= 0 else f"must be at least 0, got {value}")  # type: ignore[operator]


def point(value: object) -> str:
    """Fault of a value that must be three coordinates."""
    if not isinstance(value, list):
        return f"must be three numbers [x, y, z], got {spell(value)}"
    if len(value) != len("xyz"):
        return f"must be three numbers [x, y, z], got {len(value)} of them"
    faults = ((axis, number(coordinate)) for axis, coordinate in zip("xyz", value, strict=True))
    return "; ".join(f"{axis} {fault}" for axis, fault in faults if fault)


def laps(value: object) -> str:
    """Fault of a value that must be a number of laps."""
    if isinstance(value, bool) or not isinstance(value, int):
        return f"must be a whole number, got {spell(value)}"
    return "" if 1 <= value <= MAX_LAPS else f"must be 1 to {MAX_LAPS}, got {spell(value)}"


def label(value: object) -> str:
    """Fault of a value that must be a track's name."""
    if not isinstance(value, str):
        return f"must be text in quotes, got {spell(value)}"
    sound = value.strip() and value.isprintable()
    return "" if sound else f"must be printable text that is not blank, got {spell(value)}"


def anything(value: object) -> str:
    """No fault: the value is looked at elsewhere."""
    return ""


TRACK_KEYS: Mapping[str, Check] = {
    "name": label,
    "laps": laps,
    "frame_width": not_negative,
    "leave_distance": positive,
    "bounds": anything,
    "gates": anything,
}
BOUNDS_KEYS: Mapping[str, Check] = {"low": point, "high": point}
GATE_KEYS: Mapping[str, Check] = {
    "position": point,
    "yaw_deg": number,
    "yaw_rad": number,
    "width": positive,
    "height": positive,
}
REQUIRED = {
    "name": 'the track\'s name, as in name = "my track"',
    "low": "the lowest corner, as in low = [-20, -20, 0]",
    "high": "the highest corner, as in high = [20, 20, 10]",
    "position": "the centre of the opening, as in position = [10, 0, 2]",
}


def key_faults(table: Table, keys: Mapping[str, Check]) -> Iterator[str]:
    """Unknown keys, missing keys and unsuitable values of one table, one text each."""
    for key in table:
        if key not in keys:
            close = difflib.get_close_matches(str(key), keys, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(keys)}"
            yield f"unknown key {spell(key)}; {hint}"
    for key, check in keys.items():
        if key not in table and key in REQUIRED:
            yield f"{key} is missing: {REQUIRED[key]}"
        elif key in table and (text := check(table[key])):
            yield f"{key} {text}"


def gate_faults(gate: object) -> list[str]:
    """Faults of one element of `gates`, each on its own."""
    if not isinstance(gate, Mapping):
        return [f"must be a table, got {spell(gate)}"]
    faults = list(key_faults(gate, GATE_KEYS))
    given = [key for key in ("yaw_deg", "yaw_rad") if key in gate]
    if not given:
        faults.append("yaw_deg is missing: the heading in which the gate is flown, 0 along x, 90 along y")
    elif len(given) > 1:
        faults.append("yaw_deg and yaw_rad are both given: keep one")
    return faults


def bounds_faults(bounds: object) -> list[str]:
    """Faults of `bounds`, each on its own."""
    if not isinstance(bounds, Mapping):
        return [f"must be a table [bounds] with low and high, got {spell(bounds)}"]
    faults = list(key_faults(bounds, BOUNDS_KEYS))
    if faults:
        return faults
    low, high = bounds["low"], bounds["high"]
    for axis, a, b in zip("xyz", low, high, strict=True):
        if a >= b:
            faults.append(f"inverted: low {axis} = {a} must be less than high {axis} = {b}")
    if low[2] > 0:
        faults.append(f"low z must be at most 0, got {low[2]}: the ground is the floor")
    return faults


def gates_fault(gates: object) -> str:
    """What is wrong with `gates` as a whole."""
    if not isinstance(gates, list):
        return f"gates must be an array of tables, each headed [[gates]], got {spell(gates)}"
    if not gates:
        return "no gates: a track needs at least one [[gates]]"
    return "" if len(gates) <= MAX_GATES else f"{len(gates)} gates are too many: at most {MAX_GATES}"


def shown(path: str | os.PathLike[str]) -> str:
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
