"""What may stand in a track file: its keys, and what each one's value must be. Plain Python: no JAX."""

from collections.abc import Iterator, Mapping

from cruise import toml_file
from cruise.toml_file import LIMIT, Check, Table, label, not_negative, number, positive, shown, spell

__all__ = ["LIMIT", "Check", "Table", "label", "not_negative", "number", "positive", "shown", "spell"]

MAX_LAPS = 1000
MAX_GATES = 200


def point(value: object) -> str:
    """Fault of a value that must be three coordinates."""
    return toml_file.numbers(value, "xyz")


def laps(value: object) -> str:
    """Fault of a value that must be a number of laps."""
    return toml_file.whole(value, 1, MAX_LAPS)


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
    return toml_file.key_faults(table, keys, REQUIRED)


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
