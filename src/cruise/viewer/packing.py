"""A race log as the data of the replay page, described in `docs/replay.md`."""

from typing import Any

import numpy as np

from cruise.config import Gate
from cruise.evaluation.metrics import DroneResult, RaceResult, crash_times, events_of, overtakes, race_result
from cruise.palette import drone_colour
from cruise.racing.solids import Outline
from cruise.storage.race_log import EVENT_KINDS, EventKind, RaceLog
from cruise.viewer.painting.scenery import Scenery, log_scenery
from cruise.viewer.samples import pack_samples

DECIMALS = 4  # of times and lengths outside the samples
MOVING = 0.5  # slower drones show nothing about where they look [m/s]


def pack_race(log: RaceLog, label: str, ghost: RaceLog | None = None) -> dict[str, Any]:
    """Everything that the page shows of a race.

    Args:
        log: the race.
        label: what tells this race from the others of the page, as "seed 3".
        ghost: another race on the same track, whose drones fly along, translucent and out of competition.

    Returns:
        Plain numbers, text, lists and dictionaries.
    """
    result, scenery = race_result(log), log_scenery(log)
    drones = [_pack_drone(log, result.drones[drone], drone, ghost=False) for drone in range(log.num_drones)]
    if ghost is not None:
        results = race_result(ghost).drones
        drones += [_pack_drone(ghost, results[drone], drone, ghost=True) for drone in range(ghost.num_drones)]
    return {
        "label": label,
        "outcome": describe_outcome(result),
        "track": log.track,
        "vehicle": log.vehicle,
        "laps": log.laps,
        "duration": _number(float(log.time[-1])),
        "sample_period": _number(log.control_dt),
        **pack_scenery(scenery),
        "first_gate": int(log.next_gate[0, 0]),
        "bounds": _numbers(log.bounds),
        "first_person": "body" if looks_ahead(log) else "flight",
        "drones": drones,
        "ranking": list(result.ranking),
        "events": _pack_events(log),
        "said": {kind.stored: kind.said for kind in EventKind},
    }


def describe_outcome(result: RaceResult) -> str:
    """Who won and what went wrong, in one phrase."""
    out = sum(bool(drone.collision) for drone in result.drones)
    losses = f", {out} out" if out else ""
    return f"drone {result.winner + 1} wins{losses}" if result.winner >= 0 else f"nobody finishes{losses}"


def looks_ahead(log: RaceLog) -> bool:
    """Whether drones turn their nose to where they fly, so that a camera in the nose sees the way."""
    velocity, yaw = log.velocity_w[..., :2], log.euler[..., 2]
    speed = np.linalg.norm(velocity, axis=-1)
    moving = log.airborne & (speed > MOVING)
    if not moving.any():
        return False
    ahead = (velocity[..., 0] * np.cos(yaw) + velocity[..., 1] * np.sin(yaw))[moving] / speed[moving]
    return bool(np.median(ahead) > np.cos(np.pi / 4))


def _pack_drone(log: RaceLog, result: DroneResult, drone: int, ghost: bool) -> dict[str, Any]:
    flown = slice(0, int(log.airborne[:, drone].sum()) + 1)
    states = (array[flown, drone] for array in (log.position_w, log.velocity_w, log.euler))
    return {
        "number": drone + 1,
        "pilot": log.names[drone],
        "colour": drone_colour(drone),
        "ghost": ghost,
        "fate": result.fate,
        "finish": _number(result.finish_time),
        "crash": _number(float(crash_times(log)[drone])),
        "crossings": _numbers(events_of(log, EventKind.CROSSING, drone)),
        "samples": pack_samples(log.time[flown], *states),
    }


def pack_scenery(scenery: Scenery) -> dict[str, Any]:
    """What the page shows of a track."""
    return {
        "gates": [_pack_gate(gate) for gate in scenery.gates],
        "solids": [_pack_solid(solid) for solid in scenery.solids],
        "frame_width": _number(scenery.frame_width),
    }


def _pack_gate(gate: Gate) -> dict[str, Any]:
    height = gate.width if gate.shape == "round" else gate.height
    turns = {"yaw": _number(gate.yaw), "pitch": _number(gate.pitch), "roll": _number(gate.roll)}
    size, moves = _numbers(np.array([gate.width, height])), gate.motion
    packed = {"position": _numbers(np.array(gate.position_w)), **turns, "size": size, "shape": gate.shape}
    if moves is None:
        return packed
    numbers = {name: _number(getattr(moves, name)) for name in ("period", "swing", "phase")}
    return packed | {"motion": numbers | {"sway": _numbers(np.array(moves.sway_w))}}


def _pack_solid(solid: Outline) -> dict[str, Any]:
    centre, size = _numbers(np.array(solid.centre_w)), _numbers(np.array(solid.size))
    return {"kind": solid.kind, "shape": solid.shape, "centre": centre, "size": size, "yaw": _number(solid.yaw)}


def _pack_events(log: RaceLog) -> list[dict[str, Any]]:
    """What happened apart from crossings, in order of time."""
    columns = (log.event_time, log.event_kind, log.event_drone, log.event_gate, log.event_other)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    events = [
        _event(time, EVENT_KINDS[kind], drone, gate, other)
        for time, kind, drone, gate, other in rows
        if kind != EventKind.CROSSING
    ]
    events += [_event(time, "overtake", drone, gate, other) for time, drone, other, gate, _ in overtakes(log)]
    return sorted(events, key=lambda event: event["time"])


def _event(time: float, kind: str, drone: int, gate: int, other: int) -> dict[str, Any]:
    return {"time": _number(time), "kind": kind, "drone": drone, "gate": gate, "other": other}


def _number(value: float) -> float | None:
    """A number of JSON, which has neither NaN nor infinity."""
    return round(float(value), DECIMALS) if np.isfinite(value) else None


def _numbers(values: np.ndarray) -> list:
    return np.round(np.asarray(values, np.float64), DECIMALS).tolist()
