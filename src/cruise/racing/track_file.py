"""Tracks as TOML files, and every fault a track can have. Plain Python: no JAX.

A track file has `name`, optionally `laps`, `frame_width`, `leave_distance` and `[bounds]`, and one `[[gates]]` table
for each gate in the order of flight; `docs/tracks.md` describes every key.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import tomli_w

from cruise.config import Gate, Track, Vec3
from cruise.errors import CruiseError
from cruise.files import write_whole
from cruise.presets import TRACKS
from cruise.racing import track_geometry as geometry
from cruise.racing import track_schema as schema
from cruise.toml_file import FileKind, StrPath, read_toml, reason, refuse

MARGIN = 10.0  # of the default bounds around the openings [m]
LEAVE_DISTANCE = 10.0  # smallest default of `leave_distance` [m]
FRAME_WIDTH = 0.3  # default [m]
SIZE = 2.0  # default width and height of an opening [m]
LAPS = 3  # default
RANDOM = "random"  # the name that stands for tracks drawn at random
KIND = FileKind("track", TRACKS)

_POINT = re.compile(r"\[\n +(\S+),\n +(\S+),\n +(\S+),\n\]")  # as the writer spreads three numbers over lines


def load_track(name_or_path: StrPath) -> Track:
    """Give a built-in track by name, or the track of a TOML file.

    A built-in name wins over a file of that name; write `./ring` for the file. `random` is one of many: every race gets
    a track of its own.

    Raises:
        CruiseError: no such track, an unreadable file, or a faulty track; names the first faults.
    """
    if name_or_path == RANDOM:
        from cruise.racing.random_track import unseen_tracks  # noqa: PLC0415  (checks its tracks by this module)

        return unseen_tracks()
    if isinstance(name_or_path, str) and name_or_path in TRACKS:
        return TRACKS[name_or_path]
    document = read_document(name_or_path)
    refuse(document_faults(document), schema.shown(name_or_path), KIND.noun)
    return from_document(document)


def is_name(name_or_path: StrPath) -> bool:
    """Whether this is a track's name, so that it means the same everywhere."""
    return isinstance(name_or_path, str) and (name_or_path == RANDOM or name_or_path in TRACKS)


def load_one_track(name_or_path: StrPath) -> Track:
    """As `load_track`, for what needs to know where the gates are.

    Raises:
        CruiseError: also where `name_or_path` stands for many tracks.
    """
    if name_or_path == RANDOM:
        raise CruiseError(f"{RANDOM} is a new track in every race: write one with `cruise tracks random --out FILE`")
    return load_track(name_or_path)


def save_track(track: Track, path: StrPath) -> None:
    """Write a track as TOML, whole or not at all. `load_track` gives back an equal track.

    Raises:
        CruiseError: the track has faults, or the file cannot be written.
    """
    document = to_document(track)
    refuse(document_faults(document), f"track {schema.spell(track.name)}", KIND.noun)
    try:
        write_whole(path, _POINT.sub(r"[\1, \2, \3]", tomli_w.dumps(document)).encode())
    except (OSError, ValueError) as error:
        raise CruiseError(f"{schema.shown(path)}: cannot be written: {reason(error)}") from error


def track_faults(track: Track) -> list[str]:
    """Every fault of a track, one line each; empty when it can be raced.

    Numbers that are not finite or not positive; bounds inverted; gates that overlap, face away from the flight
    direction, lie under ground or out of bounds, or leave the next one out of reach.
    """
    return document_faults(to_document(track))


def document_faults(document: schema.Table) -> list[str]:
    """Every fault of a track file's content. Sound gates are compared even where others are faulty."""
    faults = list(schema.key_faults(document, schema.TRACK_KEYS))
    bounds_faults = schema.bounds_faults(document["bounds"]) if "bounds" in document else []
    faults += [f"bounds: {text}" for text in bounds_faults]
    gates = document.get("gates", [])
    if text := schema.gates_fault(gates):
        return [*faults, text]
    sound: dict[int, Gate] = {}
    for i, table in enumerate(gates):
        gate_faults = schema.gate_faults(table)
        faults += [f"{geometry.gate_place(i)}: {text}" for text in gate_faults]
        if not gate_faults:
            sound[i] = _gate(table)
    return faults + list(_faults_among(document, sound, bounded=not bounds_faults))


def _faults_among(document: schema.Table, gates: dict[int, Gate], bounded: bool) -> Iterator[str]:
    """Faults of sound gates towards each other and the limits, as far as those are sound themselves."""
    count = len(document["gates"])
    yield from geometry.facing_away(gates, count)
    frame_width = document.get("frame_width", FRAME_WIDTH)
    if not schema.not_negative(frame_width):
        yield from geometry.overlaps(gates, count, frame_width)
    if bounded and gates:
        yield from geometry.misplaced(gates, *_bounds(document, gates.values()))
    leave_distance = document.get("leave_distance")
    if "leave_distance" in document and not schema.positive(leave_distance):
        yield from geometry.unreachable(gates, count, document["leave_distance"])


def read_document(path: StrPath) -> dict[str, Any]:
    """Parse a TOML file. Raises CruiseError where it is missing, not a regular file, too large or not TOML."""
    return read_toml(path, KIND)


def to_document(track: Track) -> dict[str, Any]:
    """A track as what its file holds."""
    return {
        "name": track.name,
        "laps": track.laps,
        "frame_width": track.frame_width,
        "leave_distance": track.leave_distance,
        "bounds": {"low": list(track.bounds_low), "high": list(track.bounds_high)},
        "gates": [
            {"position": list(gate.position_w), **_yaw(gate.yaw), "width": gate.width, "height": gate.height}
            for gate in track.gates
        ],
    }


def from_document(document: schema.Table) -> Track:
    """The track of a document without faults."""
    gates = tuple(_gate(table) for table in document["gates"])
    low, high = _bounds(document, gates)
    longest = max(geometry.segment_lengths(gates))
    return Track(
        name=document["name"],
        gates=gates,
        bounds_low=low,
        bounds_high=high,
        laps=document.get("laps", LAPS),
        frame_width=float(document.get("frame_width", FRAME_WIDTH)),
        leave_distance=float(document.get("leave_distance", max(LEAVE_DISTANCE, longest))),
    )


def _gate(table: schema.Table) -> Gate:
    """The gate of a table without faults."""
    yaw = float(table["yaw_rad"]) if "yaw_rad" in table else math.radians(table["yaw_deg"])
    return Gate(_vec3(table["position"]), yaw, float(table.get("width", SIZE)), float(table.get("height", SIZE)))


def _yaw(yaw: float) -> dict[str, float]:
    """Degrees, where they give the same float back; radians otherwise."""
    degrees = math.degrees(yaw)
    for candidate in (round(degrees, 9), degrees):
        if math.radians(candidate) == yaw and abs(candidate) <= schema.LIMIT:
            return {"yaw_deg": candidate}
    return {"yaw_rad": yaw}


def _bounds(document: schema.Table, gates: Iterable[Gate]) -> tuple[Vec3, Vec3]:
    """Bounds as given, or a box around the gates that stands on the ground."""
    if "bounds" in document:
        return _vec3(document["bounds"]["low"]), _vec3(document["bounds"]["high"])
    return geometry.box_around(gates, MARGIN)


def _vec3(values: Sequence[float]) -> Vec3:
    x, y, z = (float(value) for value in values)
    return x, y, z
