"""Tracks as TOML files, and every fault a track can have. Plain Python: no JAX.

A track file has `name`, optionally `laps`, `finish`, `frame_width`, `frame_depth`, `leave_distance`, `[bounds]` and
`[start]`, one `[[gates]]` table for each gate in the order of flight, and `[[poles]]` and `[[walls]]`; all keys are in
`docs/tracks.md`.
"""

import re
from collections.abc import Iterable, Iterator
from typing import Any

import tomli_w

from cruise.config import Gate, Motion, Start, StartLine, StartPlace, StartPlaces, Track, Vec3
from cruise.errors import CruiseError
from cruise.files import write_whole
from cruise.presets import TRACKS
from cruise.racing import motion, start_room
from cruise.racing import track_geometry as geometry
from cruise.racing import track_schema as schema
from cruise.racing.solids import KINDS, Outline, kind_of, solid_faults
from cruise.toml_file import FileKind, StrPath, read_toml, reason, refuse

MARGIN = 10.0  # of the default bounds around the openings [m]
LEAVE_DISTANCE = 10.0  # smallest default of `leave_distance` [m]
FRAME_WIDTH = 0.3  # default [m]
SIZE = 2.0  # default width and height of an opening [m]
LAPS = 3  # default
RANDOM = "random"  # the name that stands for tracks drawn at random
ANY = "any"  # the same, and in training reshaped by every race
RANDOM_KINDS: dict[str, tuple[int, float]] = {  # obstacles, and largest roll and pitch of gates [rad]
    RANDOM: (0, 0.0),
    ANY: (0, 0.0),
    "random-cluttered": (6, 0.35),
}
MAX_SOLIDS = 200  # of a kind
KIND = FileKind("track", TRACKS)
TRACK_KEYS = {**schema.TRACK_KEYS, "start": schema.anything, **{kind.table: schema.anything for kind in KINDS}}

_POINT = re.compile(r"\[\n +(\S+),\n +(\S+),\n +(\S+),\n\]")  # as the writer spreads three numbers over lines


def load_track(name_or_path: StrPath) -> Track:
    """Give a built-in track by name, or the track of a TOML file.

    A built-in name wins over a file of that name; write `./ring` for the file. `random` and `random-cluttered` are
    many: every race gets a track of its own.

    Raises:
        CruiseError: no such track, an unreadable file, or a faulty track; names the first faults.
    """
    if isinstance(name_or_path, str) and name_or_path in RANDOM_KINDS:
        from cruise.racing.random_track import unseen_tracks  # noqa: PLC0415  (checks its tracks by this module)

        return unseen_tracks(name_or_path)
    if isinstance(name_or_path, str) and name_or_path in TRACKS:
        return TRACKS[name_or_path]
    document = read_document(name_or_path)
    refuse(document_faults(document), schema.shown(name_or_path), KIND.noun)
    return from_document(document)


def is_name(name_or_path: StrPath) -> bool:
    """Whether this is a track's name, so that it means the same everywhere."""
    return isinstance(name_or_path, str) and (name_or_path in RANDOM_KINDS or name_or_path in TRACKS)


def load_one_track(name_or_path: StrPath) -> Track:
    """As `load_track`, for what needs to know where the gates are.

    Raises:
        CruiseError: also where `name_or_path` stands for many tracks.
    """
    if isinstance(name_or_path, str) and name_or_path in RANDOM_KINDS:
        raise CruiseError(
            f"{name_or_path} is a new track in every race: write one with `cruise tracks random --out FILE`"
        )
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


def track_warnings(track: Track) -> list[str]:
    """What is worth a word about a track without faults, one line each.

    Frames that overlap, gates that face across the flight, gates without a start.
    """
    gates = dict(enumerate(track.gates))
    frames = geometry.touching_frames(gates, len(gates), track.frame_width)
    facing = geometry.facing_away(gates, len(gates), geometry.ACROSS)
    return [*frames, *facing, *start_room.start_warnings(track)]


def document_faults(document: schema.Table) -> list[str]:
    """Every fault of a track file's content. Sound gates are compared even where others are faulty."""
    faults = list(schema.key_faults(document, TRACK_KEYS))
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
    faults += [f"{geometry.gate_place(i)}: {text}" for i, gate in sound.items() if (text := _too_fast(gate))]
    faults += _faults_among(document, sound, bounded=not bounds_faults)
    if "start" in document:
        faults += [f"start: {text}" for text in schema.start_faults(document["start"], len(gates))]
    solids, solids_faults = _solids(document)
    faults += solids_faults
    if not bounds_faults and sound:
        faults += geometry.obstructions(sound, solids, *_bounds(document, sound.values()))
        faults += [] if faults else _faults_of_moving(document, sound, solids)
    return faults if faults else list(start_room.start_faults(from_document(document)))


def _solids(document: schema.Table) -> tuple[list[tuple[str, Outline]], list[str]]:
    """Outlines of sound solids with their names, and the faults of the others."""
    found, faults = [], []
    for kind in KINDS:
        tables = document.get(kind.table, [])
        if not isinstance(tables, list):
            faults.append(f"{kind.table} must be an array of tables, each headed [[{kind.table}]]")
            continue
        if len(tables) > MAX_SOLIDS:
            faults.append(f"{len(tables)} {kind.table} are too many: at most {MAX_SOLIDS}")
            continue
        for number, table in enumerate(tables, start=1):
            name = f"{kind.name} {number}"
            texts = solid_faults(kind, table)
            faults += [f"{name}: {text}" for text in texts]
            found += [] if texts else [(name, kind.outline(kind.read(table)))]
    return found, faults


def _faults_among(document: schema.Table, gates: dict[int, Gate], bounded: bool) -> Iterator[str]:
    """Faults of sound gates towards each other and the limits, as far as those are sound themselves."""
    count = len(document["gates"])
    yield from geometry.far_away(gates)
    yield from geometry.facing_away(gates, count)
    frame_width = document.get("frame_width", FRAME_WIDTH)
    if not schema.not_negative(frame_width):
        yield from geometry.overlaps(gates, count, frame_width)
    if bounded and gates:
        yield from geometry.misplaced(gates, *_bounds(document, gates.values()))
    leave_distance = document.get("leave_distance")
    if "leave_distance" in document and not schema.positive(leave_distance):
        yield from geometry.unreachable(gates, count, document["leave_distance"])


def _too_fast(gate: Gate) -> str:
    speed = motion.top_speed(gate)
    if speed <= motion.FASTEST:
        return ""
    return f"motion: moves at up to {speed:.3g} m/s, at most {motion.FASTEST:g} m/s: a longer period, or less sway"


def _faults_of_moving(
    document: schema.Table, gates: dict[int, Gate], solids: list[tuple[str, Outline]]
) -> Iterator[str]:
    """What becomes wrong where gates without faults move, each fault when it is first met."""
    bounds = _bounds(document, gates.values())
    told: set[tuple[str, ...]] = set()
    for time in motion.moments(list(gates.values())).tolist():
        now = {i: motion.gate_at(gate, time) for i, gate in gates.items()}
        for text in (*_faults_among(document, now, bounded=True), *geometry.obstructions(now, solids, *bounds)):
            what = tuple(text.split(":")[:2])
            if what not in told:
                told.add(what)
                yield f"{text}, {time:.3g} s into the race"


def read_document(path: StrPath) -> dict[str, Any]:
    """Parse a TOML file. Raises CruiseError where it is missing, not a regular file, too large or not TOML."""
    return read_toml(path, KIND)


def to_document(track: Track) -> dict[str, Any]:
    """A track as what its file holds."""
    document: dict[str, Any] = {
        "name": track.name,
        "laps": track.laps,
        **({"finish": track.finish} if track.finish != "first" else {}),
        "frame_width": track.frame_width,
        **({"frame_depth": track.frame_depth} if track.frame_depth else {}),
        "leave_distance": track.leave_distance,
        "bounds": {"low": list(track.bounds_low), "high": list(track.bounds_high)},
    }
    if track.start is not None:
        document["start"] = {"gate": track.start_gate + 1, **_start_table(track.start)}
    document["gates"] = [_gate_table(gate) for gate in track.gates]
    for solid in track.obstacles:
        kind = kind_of(solid)
        document.setdefault(kind.table, []).append(kind.write(solid))
    return document


def _gate_table(gate: Gate) -> dict[str, Any]:
    table = {"position": list(gate.position_w), **schema.angle_key("yaw", gate.yaw)}
    for name, angle in (("roll", gate.roll), ("pitch", gate.pitch)):
        table |= schema.angle_key(name, angle) if angle else {}
    moves = {"motion": _motion_table(gate.motion)} if gate.motion else {}
    if gate.shape == "round":
        return table | {"shape": gate.shape, "diameter": gate.width} | moves
    return table | {"width": gate.width, "height": gate.height} | moves


def _motion_table(moves: Motion) -> dict[str, Any]:
    table: dict[str, Any] = {"period": moves.period} | ({"sway": list(moves.sway_w)} if any(moves.sway_w) else {})
    for name, angle in (("swing", moves.swing), ("phase", moves.phase)):
        table |= schema.angle_key(name, angle) if angle else {}
    return table


def _start_table(start: Start) -> dict[str, Any]:
    if isinstance(start, StartLine):
        yaw = schema.angle_key("yaw", start.yaw)
        return {"middle": list(start.middle_w), **yaw, "spacing": start.spacing}
    return {
        "places": [{"position": list(place.position_w), **schema.angle_key("yaw", place.yaw)} for place in start.places]
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
        finish=document.get("finish", "first"),
        frame_width=float(document.get("frame_width", FRAME_WIDTH)),
        frame_depth=float(document.get("frame_depth", 0.0)),
        leave_distance=float(document.get("leave_distance", max(LEAVE_DISTANCE, longest))),
        obstacles=tuple(kind.read(table) for kind in KINDS for table in document.get(kind.table, [])),
        start=_start(document["start"]) if "start" in document else None,
        start_gate=document.get("start", {}).get("gate", 1) - 1,
    )


def _gate(table: schema.Table) -> Gate:
    """The gate of a table without faults."""
    size = float(table.get("diameter", SIZE))
    return Gate(
        schema.vec3(table["position"]),
        schema.angle(table, "yaw"),
        float(table.get("width", size)),
        float(table.get("height", size)),
        schema.angle(table, "roll"),
        schema.angle(table, "pitch"),
        table.get("shape", "rectangle"),
        _motion(table["motion"]) if "motion" in table else None,
    )


def _motion(table: schema.Table) -> Motion:
    """The motion of a table without faults."""
    sway = schema.vec3(table.get("sway", (0.0, 0.0, 0.0)))
    return Motion(float(table["period"]), sway, schema.angle(table, "swing"), schema.angle(table, "phase"))


def _start(table: schema.Table) -> Start:
    """The start of a table without faults."""
    if "places" not in table:
        return StartLine(schema.vec3(table["middle"]), schema.angle(table, "yaw"), float(table["spacing"]))
    places = table["places"]
    return StartPlaces(tuple(StartPlace(schema.vec3(one["position"]), schema.angle(one, "yaw")) for one in places))


def _bounds(document: schema.Table, gates: Iterable[Gate]) -> tuple[Vec3, Vec3]:
    """Bounds as given, or a box around the gates that stands on the ground."""
    if "bounds" in document:
        return schema.vec3(document["bounds"]["low"]), schema.vec3(document["bounds"]["high"])
    return geometry.box_around(gates, MARGIN)
