"""A small race log, made by hand."""

import numpy as np

from cruise.storage.race_log import EVENT_KINDS, EventKind, RaceLog

KINDS = (EventKind.CROSSING, EventKind.MISSED_GATE, EventKind.COLLISION_DRONE, EventKind.COLLISION_DRONE)


def small_log(samples=5, drones=2, gates=3, **changes):
    """Two drones, three gates, four events."""
    rng = np.random.default_rng(0)
    fields = {
        "time": 0.1 * np.arange(samples),
        "position_w": rng.normal(size=(samples, drones, 3)).astype(np.float32),
        "velocity_w": rng.normal(size=(samples, drones, 3)).astype(np.float32),
        "euler": rng.normal(size=(samples, drones, 3)).astype(np.float32),
        "action": rng.uniform(-1, 1, (samples, drones, 4)).astype(np.float32),
        "next_gate": np.full((samples, drones), gates - 1, np.int32),
        "airborne": np.ones((samples, drones), bool),
        "gate_position": rng.normal(size=(gates, 3)),
        "gate_yaw": rng.normal(size=gates),
        "gate_size": np.full((gates, 2), 2.0),
        "bounds": np.array([[-9.0, -9.0, 0.0], [9.0, 9.0, 9.0]]),
        "frame_width": 0.3,
        "leave_distance": 10.0,
        "event_time": np.array([0.05, 0.1, 0.25, 0.25]),
        "event_drone": np.array([0, 1, 0, 1], np.int32),
        "event_kind": np.array(KINDS, np.int32),
        "event_gate": np.array([2, 2, -1, -1], np.int32),
        "event_other": np.array([-1, -1, 1, 0], np.int32),
        "event_kind_names": np.array(EVENT_KINDS),
        "pilots": np.array([f"pilot {drone}" for drone in range(drones)]),
        "track": "ring",
        "vehicle": "paper",
        "laps": 2,
        "control_dt": 0.1,
        "collision_distance": 0.25,
    }
    return RaceLog(**fields | changes)


def crossing_log(times):
    """A log of nothing but crossings, at `times` [N, C], NaN where there is none."""
    drone, crossing = np.nonzero(np.isfinite(times))
    order = np.argsort(times[drone, crossing], kind="stable")
    drone, crossing = drone[order], crossing[order]
    drones, gates = len(times), 3
    return small_log(
        samples=2 + int(np.nanmax(times) / 0.1),
        drones=drones,
        gates=gates,
        event_time=times[drone, crossing],
        event_drone=drone.astype(np.int32),
        event_kind=np.full(len(drone), EventKind.CROSSING, np.int32),
        event_gate=((crossing + gates - 1) % gates).astype(np.int32),
        event_other=np.full(len(drone), -1, np.int32),
    )
