"""Tracks of other programs: read from their files, as their documentation describes them. Plain Python: no JAX.

Known are the configuration of lsy_drone_racing (TOML) and the tracks of marl-racing and rpg_time_optimal (YAML).
"""

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from cruise.config import Gate, StartPlace, StartPlaces, Track, Vec3
from cruise.errors import CruiseError
from cruise.extras import import_extra
from cruise.racing import track_geometry as geometry
from cruise.racing.track_file import KIND, track_faults
from cruise.racing.track_schema import MAX_GATES, point, positive, shown, spell, vec3
from cruise.toml_file import Check, StrPath, Table, key_faults, numbers, read_text, read_toml, refuse, whole
from cruise.tracks import munich

UNIT = 1e-3  # a quaternion's length may differ from 1 by so much
MARL_FRAME = 0.275  # width of a gate's frame there, which its file does not say [m]
MARGIN, CEILING = 8.0, 10.0  # of the room around a track that says none [m]


class Format(NamedTuple):
    """A file format of another program."""

    name: str
    faults: Callable[[Table], Iterator[str]]
    read: Callable[[Table, str, float], Track]  # of a document without faults, a name, the width of openings


def import_track(path: StrPath, name: str | None = None, opening: float = 1.5) -> Track:
    """The track of another program's file; `opening` [m] is that of gates where the file says none.

    Raises:
        CruiseError: the file cannot be read, is of no format that is known, or has faults; names the first.
    """
    if fault := positive(opening):
        raise CruiseError(f"the opening of gates {fault}")
    document = _document(path)
    kind = _format_of(document, shown(path))
    refuse(list(kind.faults(document)), f"{shown(path)} ({kind.name})", KIND.noun)
    track = kind.read(document, name or Path(path).stem, opening)
    refuse(track_faults(track), f"{shown(path)} ({kind.name})", KIND.noun)
    return track


def _document(path: StrPath) -> Table:
    """What a TOML or a YAML file holds."""
    if os.fspath(path).endswith(".toml"):
        return read_toml(path, KIND)
    if not os.fspath(path).endswith((".yaml", ".yml")):
        raise CruiseError(f"{shown(path)}: tracks are imported from .toml, .yaml and .yml files")
    text = read_text(path, KIND)
    yaml = import_extra("yaml", "yaml", "tracks in YAML need PyYAML")
    try:
        document = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise CruiseError(f"{shown(path)}: not YAML: {' '.join(str(error).split())[:200]}") from None
    if not isinstance(document, Mapping):
        raise CruiseError(f"{shown(path)}: holds {spell(document)} in place of keys such as gates")
    return document


def _format_of(document: Table, place: str) -> Format:
    environment, gates = document.get("env"), document.get("gates")
    if isinstance(environment, Mapping) and "track" in environment:
        return LSY
    if isinstance(gates, Mapping):
        return MARL
    if isinstance(gates, list) and not (gates and isinstance(gates[0], Mapping)):
        return CPC
    raise CruiseError(
        f"{place}: no known track: [env.track] is lsy_drone_racing's, a table gates with N marl-racing's, and a list "
        "gates of places rpg_time_optimal's"
    )


def _each(tables: object, what: str, keys: Mapping[str, Check], least: int = 0) -> Iterator[str]:
    """Faults of an array of tables."""
    if not isinstance(tables, list):
        yield f"{what}s must be an array of tables, got {spell(tables)}"
        return
    if not least <= len(tables) <= MAX_GATES:
        yield f"{what}s must be {least} to {MAX_GATES}, got {len(tables)}"
        return
    for n, table in enumerate(tables, start=1):
        if not isinstance(table, Mapping):
            yield f"{what} {n}: must be a table, got {spell(table)}"
            continue
        for key, check in keys.items():
            if text := "is missing" if key not in table else check(table[key]):
                yield f"{what} {n}: {key} {text}"


def _angles(value: object) -> str:
    return numbers(value, ("roll", "pitch", "yaw"))


def _lsy_faults(document: Table) -> Iterator[str]:
    track = document["env"]["track"]
    if not isinstance(track, Mapping):
        yield f"env.track must be a table, got {spell(track)}"
        return
    yield from _each(track.get("gates", []), "gate", {"pos": point, "rpy": _angles}, least=1)
    yield from _each(track.get("obstacles", []), "obstacle", {"pos": point})
    yield from _each(track.get("drones", []), "drone", {"pos": point, "rpy": _angles}, least=1)


def _lsy(document: Table, name: str, opening: float) -> Track:
    """Their Euler angles are about the world's x, y and z axes in turn: yaw, pitch and roll of ours."""
    del opening
    track = document["env"]["track"]
    gates = tuple((vec3(gate["pos"]), vec3(gate["rpy"])) for gate in track["gates"])
    tops = tuple(vec3(pole["pos"]) for pole in track.get("obstacles", []))
    starts = tuple(StartPlace(vec3(drone["pos"]), float(drone["rpy"][2])) for drone in track["drones"])
    return munich(name, gates, tops, starts)


def _quaternion(value: object) -> str:
    if fault := numbers(value, "wxyz"):
        return fault
    length = math.hypot(*value)  # type: ignore[misc]
    return "" if abs(length - 1) <= UNIT else f"must be a quaternion of length 1, got one of {length:.4g}"


def _size(value: object) -> str:
    return numbers(value, ("depth", "width", "height"), positive)


def _box(value: object) -> str:
    if fault := numbers(value, ("x0", "y0", "z0", "x1", "y1", "z1")):
        return fault
    low, high = value[:3], value[3:]  # type: ignore[index]
    inverted = next((axis for axis, a, b in zip("xyz", low, high, strict=True) if a >= b), "")
    return f"must have a lower {inverted} first" if inverted else ""


def _marl_faults(document: Table) -> Iterator[str]:
    gates = document["gates"]
    if fault := whole(gates.get("N"), 1, MAX_GATES) if "N" in gates else "is missing: how many gates there are":
        yield f"gates: N {fault}"
        return
    names = [f"Gate{n}" for n in range(1, gates["N"] + 1)]
    if missing := next((one for one in names if one not in gates), None):
        yield f"gates: {missing} is missing, of {gates['N']}"
        return
    keys = {"position": point, "rotation": _quaternion, "size": _size}
    yield from _each([gates[one] for one in names], "gate", keys)
    around = {"start_pos": point, "start_attitude": _quaternion, "world_box": _box}
    wanted = {"start_pos": "where a drone waits", "world_box": "the corners of the room"}
    yield from key_faults({key: document[key] for key in around if key in document}, around, wanted)


def _marl(document: Table, name: str, opening: float) -> Track:
    del opening
    table, box = document["gates"], document["world_box"]
    gates = []
    for n in range(1, table["N"] + 1):
        one = table[f"Gate{n}"]
        yaw, pitch, roll = _turns(one["rotation"])
        _, width, height = (float(side) for side in one["size"])
        gates.append(Gate(vec3(one["position"]), yaw, width, height, roll, pitch))
    start = StartPlace(vec3(document["start_pos"]), _turns(document.get("start_attitude", [1, 0, 0, 0]))[0])
    low, high = (box[0], box[1], min(float(box[2]), 0.0)), box[3:]
    longest = max(geometry.segment_lengths(gates))
    return Track(
        name,
        tuple(gates),
        vec3(low),
        vec3(high),
        laps=3 if document.get("loop", True) else 1,
        frame_width=MARL_FRAME,
        leave_distance=max(12.0, longest),
        start=StartPlaces((start,)),
    )


def _turns(quaternion: Sequence[float]) -> Vec3:
    """Yaw, pitch and roll [rad], ZYX; to the last digits of a file that is rounded to seven."""
    w, x, y, z = (float(part) for part in quaternion)
    yaw = math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return round(yaw, 6), round(pitch, 6), round(roll, 6)


def _cpc_faults(document: Table) -> Iterator[str]:
    gates = document["gates"]
    if not 1 <= len(gates) <= MAX_GATES:
        yield f"gates must be 1 to {MAX_GATES} places, got {len(gates)}"
    for n, place in enumerate(gates[:MAX_GATES], start=1):
        if fault := point(place):
            yield f"gate {n}: {fault}"
    for key in ("initial", "end"):
        table = document.get(key)
        if table is not None and not isinstance(table, Mapping):
            yield f"{key} must be a table, got {spell(table)}"
        elif table is not None and "position" in table and (fault := point(table["position"])):
            yield f"{key}: position {fault}"


def _cpc(document: Table, name: str, opening: float) -> Track:
    """A lap is what repeats itself; gates look along the bisectors of the ways in and out, as the file says nothing."""
    places = [vec3(place) for place in document["gates"]]
    end = (document.get("end") or {}).get("position")
    if end is not None:
        places.append(vec3(end))
    lap = next(n for n in range(1, len(places) + 1) if places[n:] == places[:-n])
    places = places[:lap]
    gates = tuple(Gate(here, _heading(places, n), opening, opening) for n, here in enumerate(places))
    (x0, y0, _), (x1, y1, z1) = geometry.box_around(gates, MARGIN)
    first = (document.get("initial") or {}).get("position")
    longest = max(geometry.segment_lengths(gates))
    return Track(
        name,
        gates,
        (x0, y0, 0.0),
        (x1, y1, max(z1, CEILING)),
        leave_distance=max(12.0, longest),
        start=None if first is None else StartPlaces((StartPlace(vec3(first), _towards(vec3(first), places[0])),)),
    )


def _heading(places: Sequence[Vec3], n: int) -> float:
    """Of the bisector of the ways in and out, in whole degrees [rad]; along the way in where it has none."""
    before, here, after = places[n - 1], places[n], places[(n + 1) % len(places)]
    x = y = 0.0
    for a, b in pairwise((before, here, after)):
        length = math.dist(a, b) or 1.0
        x, y = x + (b[0] - a[0]) / length, y + (b[1] - a[1]) / length
    heading = math.atan2(y, x) if math.hypot(x, y) > 1e-6 else _towards(before, here)
    return math.radians(round(math.degrees(heading)))


def _towards(a: Vec3, b: Vec3) -> float:
    return math.atan2(b[1] - a[1], b[0] - a[0])


LSY = Format("lsy_drone_racing", _lsy_faults, _lsy)
MARL = Format("marl-racing", _marl_faults, _marl)
CPC = Format("rpg_time_optimal", _cpc_faults, _cpc)
