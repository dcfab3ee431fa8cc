"""What may stand in a track file: its keys, and what each one's value must be. Plain Python: no JAX."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import get_args

from cruise import toml_file
from cruise.config import Finish, GateShape, Vec3
from cruise.racing.motion import WIDEST
from cruise.toml_file import LIMIT, Check, Table, label, not_negative, number, positive, shown, spell

__all__ = ["LIMIT", "Check", "Table", "label", "not_negative", "number", "positive", "shown", "spell"]

MAX_LAPS = 1000
MAX_GATES = 200


def point(value: object) -> str:
    """Fault of a value that must be three coordinates."""
    return toml_file.numbers(value, "xyz")


def sides(value: object) -> str:
    """Fault of a value that must be the three sides of a box."""
    return toml_file.numbers(value, ("length", "thickness", "height"), positive)


def laps(value: object) -> str:
    """Fault of a value that must be a number of laps."""
    return toml_file.whole(value, 1, MAX_LAPS)


def anything(value: object) -> str:
    """No fault: the value is looked at elsewhere."""
    return ""


TRACK_KEYS: Mapping[str, Check] = {
    "name": label,
    "laps": laps,
    "finish": lambda value: toml_file.choice(value, get_args(Finish)),
    "frame_width": not_negative,
    "frame_depth": not_negative,
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
    "roll_deg": number,
    "roll_rad": number,
    "pitch_deg": number,
    "pitch_rad": number,
    "shape": lambda value: toml_file.choice(value, get_args(GateShape)),
    "diameter": positive,
    "motion": anything,
}
MOTION_KEYS: Mapping[str, Check] = {
    "period": positive,
    "sway": point,
    "swing_deg": number,
    "swing_rad": number,
    "phase_deg": number,
    "phase_rad": number,
}
START_KEYS: Mapping[str, Check] = {
    "gate": lambda value: toml_file.whole(value, 1, MAX_GATES),
    "places": lambda value: (
        "" if isinstance(value, list) and value else f"must be an array of places, got {spell(value)}"
    ),
    "middle": point,
    "yaw_deg": number,
    "yaw_rad": number,
    "spacing": positive,
}
PLACE_KEYS: Mapping[str, Check] = {"position": point, "yaw_deg": number, "yaw_rad": number}
REQUIRED = {
    "name": 'the track\'s name, as in name = "my track"',
    "low": "the lowest corner, as in low = [-20, -20, 0]",
    "high": "the highest corner, as in high = [20, 20, 10]",
    "position": "the centre of the opening, as in position = [10, 0, 2]",
    "period": "how long it takes the gate to move to and fro, as in period = 4 [s]",
}


def key_faults(table: Table, keys: Mapping[str, Check]) -> Iterator[str]:
    """Unknown keys, missing keys and unsuitable values of one table, one text each."""
    return toml_file.key_faults(table, keys, REQUIRED)


def gate_faults(gate: object) -> list[str]:
    """Faults of one element of `gates`, each on its own."""
    if not isinstance(gate, Mapping):
        return [f"must be a table, got {spell(gate)}"]
    faults = list(key_faults(gate, GATE_KEYS))
    faults += angle_faults(gate, "yaw", "the heading in which the gate is flown, 0 along x, 90 along y")
    faults += [*angle_faults(gate, "roll"), *angle_faults(gate, "pitch")]
    if gate.get("shape") == "round":
        faults += [f"{key} is given: a round gate has a diameter" for key in ("width", "height") if key in gate]
    elif "diameter" in gate:
        faults.append('diameter is given, which a round gate has: add shape = "round"')
    return [*faults, *(f"motion: {text}" for text in _motion_faults(gate["motion"]))] if "motion" in gate else faults


def _motion_faults(motion: object) -> Iterator[str]:
    """Faults of how a gate moves, one text each."""
    if not isinstance(motion, Mapping):
        yield f"must be a table, as in motion = {{ sway = [0, 1, 0], period = 4 }}, got {spell(motion)}"
        return
    faults = [*key_faults(motion, MOTION_KEYS), *angle_faults(motion, "swing"), *angle_faults(motion, "phase")]
    yield from faults
    if faults:
        return
    swing = angle(motion, "swing")
    if not (swing or any(motion.get("sway", ()))):
        yield "nothing moves: give sway, metres to either side along x, y, z, or swing_deg"
    if not 0 <= swing <= WIDEST:
        yield f"swing_deg must be 0 to {math.degrees(WIDEST):g}, to either side, got {math.degrees(swing):g}"


def angle_faults(table: Table, name: str, meaning: str = "") -> Iterator[str]:
    """An angle is given in degrees or in radians, not in both; it must be where it has a `meaning` that says what."""
    given = [key for key in (f"{name}_deg", f"{name}_rad") if key in table]
    if meaning and not given:
        yield f"{name}_deg is missing: {meaning}"
    if len(given) > 1:
        yield f"{name}_deg and {name}_rad are both given: keep one"


def angle(table: Table, name: str) -> float:
    """An angle of a table without faults [rad]; 0 where it is not given."""
    return float(table[f"{name}_rad"]) if f"{name}_rad" in table else math.radians(table.get(f"{name}_deg", 0.0))


def angle_key(name: str, radians: float) -> dict[str, float]:
    """Degrees, where they give the same float back; radians otherwise."""
    degrees = math.degrees(radians)
    for candidate in (round(degrees, 9), degrees):
        if math.radians(candidate) == radians and abs(candidate) <= LIMIT:
            return {f"{name}_deg": candidate}
    return {f"{name}_rad": radians}


def vec3(values: Sequence[float]) -> Vec3:
    """Three numbers of a table without faults."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def start_faults(start: object, gates: int) -> list[str]:
    """Faults of `start`, each on its own."""
    if not isinstance(start, Mapping):
        return [f"must be a table [start], got {spell(start)}"]
    faults = list(key_faults(start, START_KEYS))
    if faults:
        return faults
    if start.get("gate", 1) > gates:
        faults.append(f"gate must be 1 to {gates}, got {start['gate']}")
    line = [key for key in ("middle", "yaw_deg", "yaw_rad", "spacing") if key in start]
    if "places" not in start:
        if not line:
            return [*faults, "needs places, or the middle, yaw_deg and spacing of a line"]
        faults += [
            f"{key} is missing: a line has middle, yaw_deg and spacing"
            for key in ("middle", "spacing")
            if key not in start
        ]
        return [*faults, *angle_faults(start, "yaw", "where drones look, 0 along x, 90 along y")]
    faults += [f"{key} is given beside places: keep one" for key in line]
    for number_, place in enumerate(start["places"], start=1):
        texts = _place_faults(place)
        faults += [f"place {number_}: {text}" for text in texts]
    return faults


def _place_faults(place: object) -> list[str]:
    if not isinstance(place, Mapping):
        return [f"must be a table, got {spell(place)}"]
    return [*key_faults(place, PLACE_KEYS), *angle_faults(place, "yaw", "where the drone looks, 0 along x, 90 along y")]


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
