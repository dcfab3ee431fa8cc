"""From what a rollout flew to one race log per race, with events at interpolated times."""

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array

from cruise import geometry
from cruise.config import Gate, Track
from cruise.racing.events import COLLISION_KINDS, EVENT_KINDS, EventKind
from cruise.racing.gates import Crossing
from cruise.racing.motion import motion_row
from cruise.racing.solids import KINDS, outlines, solid_columns, solids_of_columns
from cruise.rollout import Flight
from cruise.storage.race_log import NOBODY, RaceLog

Point = tuple[np.ndarray, ...]  # x, y, z
Flags = np.ndarray | Array  # the flight's types are the environment's, its arrays NumPy's


class RaceInfo(NamedTuple):
    """What a log says of its race beside the flight."""

    track: Track
    laps: int
    vehicle: str | Sequence[str]  # its name, or one per drone
    collision_distance: float  # [m]
    pilots: Sequence[str]  # names, one per drone
    collision_aspect: float = 1.0  # height per width of the ellipsoid in which two drones collide


class _Events(NamedTuple):
    """Events of all races; one row each."""

    race: np.ndarray
    time: np.ndarray
    kind: np.ndarray
    drone: np.ndarray
    gate: np.ndarray
    other: np.ndarray


class _Hits(NamedTuple):
    """Where a flag of the flight is set: the step, drone and race of every row."""

    step: np.ndarray
    drone: np.ndarray
    race: np.ndarray


def race_logs(flight: Flight, info: RaceInfo) -> list[RaceLog]:
    """One log per race of a batch [E], each ending when its last drone has finished or is out."""
    events = _all_events(flight, info)
    return [_one_log(flight, info, events, race) for race in range(flight.airborne.shape[2])]


def _one_log(flight: Flight, info: RaceInfo, events: _Events, race: int) -> RaceLog:
    airborne, track = flight.airborne[:, :, race], _track_flown(flight, info.track, race)
    samples = min(int(airborne.any(axis=1).sum()) + 1, len(airborne))
    mine = _Events(*(column[events.race == race] for column in events))
    action = np.zeros((samples, airborne.shape[1], flight.action.shape[1]), np.float32)
    action[:-1] = np.moveaxis(flight.action[: samples - 1, :, :, race], 1, 2)
    return RaceLog(
        time=_time(flight, np.arange(samples)),
        position_w=_users(flight.position_w[:samples, :, :, race]),
        velocity_w=_users(flight.velocity_w[:samples, :, :, race]),
        euler=_users(flight.euler[:samples, :, :, race]),
        action=action,
        next_gate=flight.next_gate[:samples, :, race].astype(np.int32),
        airborne=airborne[:samples].copy(),
        **track_arrays(track),
        event_time=mine.time,
        event_drone=mine.drone,
        event_kind=mine.kind,
        event_gate=mine.gate,
        event_other=mine.other,
        event_kind_names=np.array(EVENT_KINDS),
        pilots=np.array(info.pilots, dtype=str),
        vehicle=info.vehicle if isinstance(info.vehicle, str) else ", ".join(dict.fromkeys(info.vehicle)),
        vehicles=np.broadcast_to(np.array(info.vehicle, dtype=str), airborne.shape[1]).copy(),
        laps=info.laps,
        control_dt=flight.control_dt,
        collision_distance=info.collision_distance,
        collision_aspect=info.collision_aspect,
    )


def _track_flown(flight: Flight, track: Track, race: int) -> Track:
    """The track with its gates and solids where this race had them."""
    if flight.moved is None:
        return track
    centre, turns = _gates_flown(flight, track, np.array([race]))
    gates = (
        dataclasses.replace(gate, position_w=(float(x), float(y), float(z)), yaw=yaw, pitch=pitch, roll=roll)
        for gate, (x, y, z), (yaw, pitch, roll) in zip(
            track.gates, centre[:, :, 0], turns[:, :, 0].tolist(), strict=True
        )
    )
    track = dataclasses.replace(track, gates=tuple(gates))
    solids = flight.moved.solids
    if solids is None:
        return track
    here = solids_of_columns({kind: np.asarray(table)[:, :, race] for kind, table in solids.items()})
    return dataclasses.replace(track, obstacles=here)


def _gates_flown(flight: Flight, track: Track, race: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres [G, 3, R] of all gates at rest in each of some races, and their yaws, pitches and rolls [G, 3, R]."""
    rows, moved = len(race), flight.moved
    turns = np.array([(gate.yaw, gate.pitch, gate.roll) for gate in track.gates])[:, :, None].repeat(rows, 2)
    if moved is None:
        return np.array([gate.position_w for gate in track.gates])[:, :, None].repeat(rows, 2), turns
    position, (cos, sin) = (np.asarray(table, np.float64) for table in (moved.position_w, moved.normal_w))
    turns[:, 0] = np.arctan2(sin, cos)[:, race]
    if moved.tilt is not None:
        cos_pitch, sin_pitch, cos_roll, sin_roll = np.asarray(moved.tilt, np.float64)[:, :, race]
        turns[:, 1], turns[:, 2] = np.arctan2(sin_pitch, cos_pitch), np.arctan2(sin_roll, cos_roll)
    return position[:, :, race].swapaxes(0, 1), turns


def _moved_on(gate: Gate, place: tuple[np.ndarray, np.ndarray], time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and yaw, pitch, roll [3, R] of a gate at times [R], from where it is at rest."""
    if gate.motion is None:
        return place
    centre, turns = place
    share = np.sin(2 * np.pi * time / gate.motion.period + gate.motion.phase)
    sway, swing = np.array(gate.motion.sway_w)[:, None], np.array([gate.motion.swing, 0.0, 0.0])[:, None]
    return centre + sway * share, turns + swing * share


def _solids_flown(flight: Flight, track: Track, kind: str, race: np.ndarray) -> Iterator[np.ndarray]:
    """The numbers of every solid of a kind in each of some races [C, R]."""
    if flight.moved is not None and flight.moved.solids is not None:
        table = np.asarray(flight.moved.solids[kind], np.float64)[:, :, race]
    else:
        table = solid_columns(track.obstacles)[kind][:, :, None].repeat(len(race), 2)
    return iter(table.swapaxes(0, 1))


def track_arrays(track: Track) -> dict[str, Any]:
    """The fields of a log that its track decides."""
    gates, solids = track.gates, list(outlines(track.obstacles))
    return {
        "track": track.name,
        "gate_position": np.array([gate.position_w for gate in gates], np.float64),
        "gate_yaw": np.array([gate.yaw for gate in gates], np.float64),
        "gate_size": np.array([(gate.width, gate.height) for gate in gates], np.float64),
        "bounds": np.array([track.bounds_low, track.bounds_high], np.float64),
        "frame_width": track.frame_width,
        "leave_distance": track.leave_distance,
        "finish": track.finish,
        "gate_roll": np.array([gate.roll for gate in gates], np.float64),
        "gate_pitch": np.array([gate.pitch for gate in gates], np.float64),
        "gate_shape": np.array([gate.shape for gate in gates]),
        "gate_motion": np.array([motion_row(gate.motion) for gate in gates], np.float64),
        "solid_kind": np.array([solid.kind for solid in solids], dtype=str),
        "solid_shape": np.array([solid.shape for solid in solids], dtype=str),
        "solid_position": np.array([solid.centre_w for solid in solids], np.float64).reshape(-1, 3),
        "solid_yaw": np.array([solid.yaw for solid in solids], np.float64),
        "solid_size": np.array([solid.size for solid in solids], np.float64).reshape(-1, 3),
    }


def _users(values: np.ndarray) -> np.ndarray:
    """[T, 3, N] -> [T, N, 3], laid out anew."""
    return np.ascontiguousarray(np.moveaxis(values, 1, 2))


def _time(flight: Flight, step: np.ndarray) -> np.ndarray:
    """Seconds since the start of (fractions of) steps."""
    return step * flight.control_dt


def _all_events(flight: Flight, info: RaceInfo) -> _Events:
    """Events of all races, in order of race and time."""
    parts, gates = [_collisions(flight, info)], len(info.track.gates)
    for ahead, crossing in enumerate(_crossings(flight)):
        missed = np.asarray(crossing.missed) & flight.airborne[:-1]
        parts.append(_at_gate(flight, EventKind.CROSSING, crossing.passed, ahead, gates))
        parts.append(_at_gate(flight, EventKind.MISSED_GATE, missed, ahead, gates))
        parts.append(_at_gate(flight, EventKind.FINISH, _finishes(flight, ahead), ahead, gates))
    events = _Events(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    order = np.lexsort((events.drone, events.kind, events.time, events.race))
    return _Events(*(column[order] for column in events))


def _crossings(flight: Flight) -> tuple[Crossing, ...]:
    """Of the target gate and, where a step can reach so far, of those after it."""
    return (flight.crossing, *flight.further)


def _finishes(flight: Flight, ahead: int) -> np.ndarray:
    """Whether a race was finished at the gate that lies so many after the target: the last one passed in the step."""
    passed, *later = (np.asarray(crossing.passed) for crossing in _crossings(flight)[ahead:])
    last = functools.reduce(np.logical_and, [~other for other in later], passed)
    return np.asarray(flight.finished[1:] & ~flight.finished[:-1] & last)


def _at_gate(flight: Flight, kind: EventKind, flags: Flags, ahead: int, gates: int) -> _Events:
    """Events in the plane of the gate that lies so many after the target."""
    crossing = _crossings(flight)[ahead]
    hits = _hits(flags)
    gate = (flight.next_gate[:-1][hits] + ahead) % gates
    return _events(flight, kind, hits, np.asarray(crossing.fraction)[hits], gate=gate)


def _collisions(flight: Flight, info: RaceInfo) -> _Events:
    """Collisions of all kinds, but for those after the end of a drone's race within the same step."""
    met = {kind: _hits(getattr(flight.collisions, kind.hit)) for kind in COLLISION_KINDS}
    contacts = {kind: _contact(kind, flight, hits, info) for kind, hits in met.items() if len(hits.step)}
    finished = flight.finished[1:] & ~flight.finished[:-1]
    end = np.where(flight.airborne[1:] & ~finished, np.inf, np.where(finished, -1.0, 1.0))
    for kind, contact in contacts.items():
        np.minimum.at(end, met[kind], np.where(np.isinf(end[met[kind]]), np.inf, contact.fraction))
    parts = [_no_events()]
    for kind, contact in contacts.items():
        before = contact.fraction <= end[met[kind]]
        hits = _Hits(*(column[before] for column in met[kind]))
        parts.append(_events(flight, kind, hits, *(column[before] for column in contact)))
    return _Events(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class _Contact(NamedTuple):
    """When in its step each of some collisions happened, and with what."""

    fraction: np.ndarray
    gate: np.ndarray
    other: np.ndarray


def _contact(kind: EventKind, flight: Flight, hits: _Hits, info: RaceInfo) -> _Contact:
    """In double precision; at the end of the step where the rules notice nothing sooner."""
    row, nobody = np.arange(len(hits.step)), np.full(len(hits.step), NOBODY)
    starts, ends = _segments(flight, hits)
    start, end = (tuple(points[row, :, hits.drone].T) for points in (starts, ends))
    gate, other, fraction = nobody, nobody, np.ones(len(row))
    if kind == EventKind.COLLISION_DRONE:
        other, fraction = _meet_drone(flight, hits, starts, ends, info)
    elif kind == EventKind.COLLISION_GATE_FRAME:
        gate, fraction = _meet_frame(flight, hits, start, end, info.track)
    elif kind == EventKind.COLLISION_GROUND:
        fraction = geometry.fall_below(start[2], end[2])
    elif kind == EventKind.COLLISION_BOUNDS:
        fraction = _leave_box(info.track, start, end)
    else:
        met = [
            solid.contact(column, start, end)
            for solid in KINDS
            if solid.name == kind.hit
            for column in _solids_flown(flight, info.track, kind.hit, hits.race)
        ]
        fraction = np.min([fraction, *met], axis=0)
    return _Contact(np.minimum(fraction, 1.0), gate, other)


def _events(
    flight: Flight, kind: int, hits: _Hits, fraction: np.ndarray, gate: np.ndarray, other: np.ndarray | None = None
) -> _Events:
    time = _time(flight, hits.step + fraction.astype(np.float64))
    other = np.full(len(time), NOBODY) if other is None else other
    columns = (np.full(len(time), kind), hits.drone, gate, other)
    return _Events(hits.race, time, *(np.asarray(column, np.int32) for column in columns))


def _no_events() -> _Events:
    none = np.zeros(0, np.int32)
    return _Events(none, np.zeros(0), none, none, none, none)


def _hits(flags: Flags) -> _Hits:
    return _Hits(*np.nonzero(flags))


def _segments(flight: Flight, hits: _Hits) -> tuple[np.ndarray, np.ndarray]:
    """Where every drone of the race starts and ends the step of each hit [R, 3, N], in double precision."""
    position = flight.position_w
    start, end = (position[hits.step + ahead, :, :, hits.race].astype(np.float64) for ahead in (0, 1))
    return start, end


def _meet_drone(
    flight: Flight, hits: _Hits, start: np.ndarray, end: np.ndarray, info: RaceInfo
) -> tuple[np.ndarray, np.ndarray]:
    """The nearest drone of the step, and when the two came within the collision distance."""
    row, wide = np.arange(len(hits.step)), np.array([1.0, 1.0, 1 / info.collision_aspect])[:, None]
    start, end = start * wide, end * wide
    offset = start - start[row, :, hits.drone][:, :, None]
    motion = (end - end[row, :, hits.drone][:, :, None]) - offset
    offset, motion = offset.swapaxes(0, 1), motion.swapaxes(0, 1)  # [3, R, N]
    nearest2 = geometry.distance2_at(offset, motion, geometry.nearest_fraction(offset, motion))
    possible = flight.airborne[:-1][hits.step, :, hits.race]
    possible[row, hits.drone] = False
    other = np.where(possible, nearest2, np.inf).argmin(axis=1)
    # a verdict in single precision may be one by a hair
    radius = np.maximum(info.collision_distance, np.sqrt(nearest2[row, other]) * (1 + 1e-12) + 1e-12)
    return other, geometry.meet_sphere(offset[:, row, other], motion[:, row, other], radius)


def _leave_box(track: Track, start: Point, end: Point) -> np.ndarray:
    """Where the box of the track is left."""
    faces = [(1, axis, track.bounds_high[axis]) for axis in range(3)]
    faces += [(-1, axis, -track.bounds_low[axis]) for axis in range(2)]
    left = [geometry.leave_above(side * start[axis], side * end[axis], limit) for side, axis, limit in faces]
    return np.asarray(np.min(left, axis=0))


def _meet_frame(flight: Flight, hits: _Hits, start: Point, end: Point, track: Track) -> tuple[np.ndarray, np.ndarray]:
    """The gate whose frame was struck first, and when."""
    flown = zip(*_gates_flown(flight, track, hits.race), strict=True)
    times = _time(flight, hits.step), _time(flight, hits.step + 1)
    by_gate = [
        _frame_misfit(gate, track.frame_width, tuple(_moved_on(gate, place, time) for time in times), (start, end))
        for gate, place in zip(track.gates, flown, strict=True)
    ]
    misfit, fraction = np.array(by_gate).swapaxes(0, 1)
    gate = (misfit + 1e-3 * fraction).argmin(axis=0)
    return gate, fraction[gate, np.arange(len(hits.step))]


def _frame_misfit(
    gate: Gate, frame_width: float, places: Sequence[tuple[np.ndarray, np.ndarray]], segment: tuple[Point, Point]
) -> tuple[np.ndarray, np.ndarray]:
    """How far [m] segments are from striking a gate's frame, 0 for those that do, and the fraction at its plane.

    `places` are its centre and yaw, pitch, roll in each race [3, R] at both ends of the segments.
    """
    before, after = (_seen_from(place, point) for place, point in zip(places, segment, strict=True))
    length = after[0] - before[0]
    free = -before[0] / np.where(length == 0, 1.0, length)
    fraction = np.clip(free, 0.0, 1.0)
    left, up = (before[axis] + fraction * (after[axis] - before[axis]) for axis in (1, 2))
    offset = geometry.beyond_opening(left, up, gate.width / 2, gate.height / 2, gate.shape == "round")
    beyond = np.maximum(-offset, 0.0) + np.maximum(offset - frame_width, 0.0)
    return beyond + np.abs(free - fraction) * np.abs(length), fraction


def _seen_from(place: tuple[np.ndarray, np.ndarray], point: Point) -> tuple[np.ndarray, ...]:
    """Points in the frames of a gate: forward, left, up [m]."""
    centre, (yaw, pitch, roll) = place
    heading, tilt = (np.cos(yaw), np.sin(yaw)), (np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll))
    return geometry.to_gate(heading, tuple(a - c for a, c in zip(point, centre, strict=True)), tilt)
