"""From what a rollout flew to one race log per race, with events at interpolated times."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array

from cruise.config import Track
from cruise.rollout import Flight
from cruise.storage.race_log import EVENT_KINDS, NOBODY, EventKind, RaceLog

Flags = np.ndarray | Array  # the flight's types are the environment's, its arrays NumPy's


class RaceInfo(NamedTuple):
    """What a log says of its race beside the flight."""

    track: Track
    laps: int
    vehicle: str
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
        vehicle=info.vehicle,
        laps=info.laps,
        control_dt=flight.control_dt,
        collision_distance=info.collision_distance,
        collision_aspect=info.collision_aspect,
    )


def _track_flown(flight: Flight, track: Track, race: int) -> Track:
    """The track with its gates where this race had them."""
    if flight.moved is None:
        return track
    position, yaw = _gates_flown(flight, track, np.array([race]))
    gates = (
        dataclasses.replace(gate, position_w=(float(x), float(y), float(z)), yaw=float(yaw[g, 0]))
        for g, (gate, (x, y, z)) in enumerate(zip(track.gates, position[:, :, 0], strict=True))
    )
    return dataclasses.replace(track, gates=tuple(gates))


def _gates_flown(flight: Flight, track: Track, race: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres [G, 3, R] and yaws [G, R] of all gates in each of some races."""
    if flight.moved is None:
        rows = len(race)
        centre = np.array([gate.position_w for gate in track.gates])[:, :, None].repeat(rows, 2)
        return centre, np.array([gate.yaw for gate in track.gates])[:, None].repeat(rows, 1)
    position, (cos, sin) = (np.asarray(table, np.float64) for table in (flight.moved.position_w, flight.moved.normal_w))
    return position[:, :, race].swapaxes(0, 1), np.arctan2(sin, cos)[:, race]


def track_arrays(track: Track) -> dict[str, Any]:
    """The fields of a log that its track decides."""
    gates = track.gates
    return {
        "track": track.name,
        "gate_position": np.array([gate.position_w for gate in gates], np.float64),
        "gate_yaw": np.array([gate.yaw for gate in gates], np.float64),
        "gate_size": np.array([(gate.width, gate.height) for gate in gates], np.float64),
        "bounds": np.array([track.bounds_low, track.bounds_high], np.float64),
        "frame_width": track.frame_width,
        "leave_distance": track.leave_distance,
    }


def _users(values: np.ndarray) -> np.ndarray:
    """[T, 3, N] -> [T, N, 3], laid out anew."""
    return np.ascontiguousarray(np.moveaxis(values, 1, 2))


def _time(flight: Flight, step: np.ndarray) -> np.ndarray:
    """Seconds since the start of (fractions of) steps."""
    return step * flight.control_dt


def _all_events(flight: Flight, info: RaceInfo) -> _Events:
    """Events of all races, in order of race and time."""
    crossing, collisions = flight.crossing, flight.collisions
    finished = flight.finished[1:] & ~flight.finished[:-1]
    parts = [
        _at_target(flight, EventKind.CROSSING, crossing.passed),
        _at_target(flight, EventKind.MISSED_GATE, crossing.missed & flight.airborne[:-1]),
        _between_drones(flight, collisions.drone, info),
        _at_end(flight, EventKind.COLLISION_GROUND, collisions.ground),
        _at_frame(flight, collisions.gate_frame, info.track),
        _at_end(flight, EventKind.COLLISION_BOUNDS, collisions.bounds),
        _at_end(flight, EventKind.COLLISION_FLIP, collisions.flip),
        _at_target(flight, EventKind.FINISH, finished),
    ]
    events = _Events(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    order = np.lexsort((events.drone, events.kind, events.time, events.race))
    return _Events(*(column[order] for column in events))


def _events(
    flight: Flight, kind: int, hits: _Hits, fraction: np.ndarray, gate: np.ndarray, other: np.ndarray
) -> _Events:
    time = _time(flight, hits.step + fraction.astype(np.float64))
    columns = (np.full(len(time), kind), hits.drone, gate, other)
    return _Events(hits.race, time, *(np.asarray(column, np.int32) for column in columns))


def _hits(flags: Flags) -> _Hits:
    return _Hits(*np.nonzero(flags))


def _none(hits: _Hits) -> np.ndarray:
    return np.full(len(hits.step), NOBODY)


def _at_target(flight: Flight, kind: int, flags: Flags) -> _Events:
    """Events in the plane of the target gate."""
    hits = _hits(flags)
    return _events(
        flight, kind, hits, np.asarray(flight.crossing.fraction)[hits], flight.next_gate[:-1][hits], _none(hits)
    )


def _at_end(flight: Flight, kind: int, flags: Flags) -> _Events:
    """Events that the rules notice at the end of a step."""
    hits = _hits(flags)
    return _events(flight, kind, hits, np.ones(len(hits.step)), _none(hits), _none(hits))


def _segments(flight: Flight, hits: _Hits) -> tuple[np.ndarray, np.ndarray]:
    """Where every drone of the race starts and ends the step of each hit [R, 3, N], in double precision."""
    position = flight.position_w
    start, end = (position[hits.step + ahead, :, :, hits.race].astype(np.float64) for ahead in (0, 1))
    return start, end


def _between_drones(flight: Flight, flags: Flags, info: RaceInfo) -> _Events:
    """Collisions with the nearest drone of the step, when the two came within the collision distance."""
    hits, distance = _hits(flags), info.collision_distance
    wide = np.array([1.0, 1.0, 1 / info.collision_aspect])[:, None]
    start, end = (points * wide for points in _segments(flight, hits))
    row = np.arange(len(hits.step))
    offset = start - start[row, :, hits.drone][:, :, None]
    motion = (end - end[row, :, hits.drone][:, :, None]) - offset
    m2, om, o2 = ((a * b).sum(axis=1) for a, b in ((motion, motion), (offset, motion), (offset, offset)))
    nearest = np.clip(-om / np.maximum(m2, 1e-12), 0.0, 1.0)
    closest2 = o2 + 2 * nearest * om + nearest**2 * m2
    possible = flight.airborne[:-1][hits.step, :, hits.race]
    possible[row, hits.drone] = False
    other = np.where(possible, closest2, np.inf).argmin(axis=1)
    m2, om, o2 = m2[row, other], om[row, other], o2[row, other]
    root = np.sqrt(np.maximum(om**2 - m2 * (o2 - distance**2), 0.0))
    fraction = np.where(o2 <= distance**2, 0.0, np.clip((-om - root) / np.maximum(m2, 1e-12), 0.0, 1.0))
    return _events(flight, EventKind.COLLISION_DRONE, hits, fraction, _none(hits), other)


def _at_frame(flight: Flight, flags: Flags, track: Track) -> _Events:
    """Collisions with the frame of a gate, in its plane."""
    hits = _hits(flags)
    row = np.arange(len(hits.step))
    start, end = (points[row, :, hits.drone] for points in _segments(flight, hits))
    flown = zip(*_gates_flown(flight, track, hits.race), strict=True)
    by_gate = [
        _frame_misfit(_Opening(centre.T, yaw, gate.width / 2, gate.height / 2), track.frame_width, start, end)
        for gate, (centre, yaw) in zip(track.gates, flown, strict=True)
    ]
    misfit, fraction = np.array(by_gate).swapaxes(0, 1)
    gate = (misfit + 1e-3 * fraction).argmin(axis=0)
    return _events(flight, EventKind.COLLISION_GATE_FRAME, hits, fraction[gate, row], gate, _none(hits))


class _Opening(NamedTuple):
    """A gate where each of some races has it."""

    centre: np.ndarray  # [R, 3] m
    yaw: np.ndarray  # [R] rad
    half_width: float  # [m]
    half_height: float  # [m]


def _frame_misfit(
    gate: _Opening, frame_width: float, start: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far [m] segments are from striking a gate's frame, 0 for those that do, and the fraction at its plane."""
    cos, sin, none, one = np.cos(gate.yaw), np.sin(gate.yaw), 0 * gate.yaw, 1 + 0 * gate.yaw
    axes = np.array([[cos, sin, none], [-sin, cos, none], [none, none, one]])  # forward, left, up
    before, after = (np.einsum("ijr,rj->ri", axes, point - gate.centre) for point in (start, end))
    length = after[:, 0] - before[:, 0]
    free = -before[:, 0] / np.where(length == 0, 1.0, length)
    fraction = np.clip(free, 0.0, 1.0)
    at = before + fraction[:, None] * (after - before)
    offset = np.maximum(np.abs(at[:, 1]) - gate.half_width, np.abs(at[:, 2]) - gate.half_height)
    beyond = np.maximum(-offset, 0.0) + np.maximum(offset - frame_width, 0.0)
    missed_plane = np.abs(free - fraction) * np.abs(length)
    return beyond + missed_plane, fraction
