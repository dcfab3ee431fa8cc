"""A time-optimal flight as a race log, which the replay shows as it shows any other, or as a ghost."""

import numpy as np
from scipy.spatial.transform import Rotation

from cruise.limit import cascade
from cruise.limit.lap import Limit
from cruise.limit.models import ATTITUDE, POSITION, VELOCITY
from cruise.limit.transcription import between
from cruise.storage.race_log import EVENT_KINDS, NOBODY, EventKind, RaceLog
from cruise.storage.recorder import track_arrays

PILOT = "limit"


def limit_log(limit: Limit, laps: int = 1) -> RaceLog:
    """Its flight, sampled as the vehicle's other races are; a lap in periodic flight is repeated `laps` times.

    The clock starts in the plane of gate 0, or where a dash does. Actions are not known, and zero, but for a vehicle
    that is flown in steps.
    """
    lap, gates, dt = limit.lap, limit.track.gates, limit.vehicle.control_dt
    from_rest = limit.standing_laps > 0 or limit.dash is not None
    crossings = np.cumsum(lap.duration if from_rest else np.tile(lap.duration, laps))
    if limit.dash is None:
        crossings = np.concatenate([[0.0], crossings])
    time = np.arange(int(np.ceil(crossings[-1] / dt - 1e-9)) + 1) * dt
    at = np.minimum(time, lap.time) if from_rest else time % lap.time
    gate = np.arange(len(crossings)) % len(gates)
    event_time, event_gate = np.append(crossings, crossings[-1]), np.append(gate, gate[-1])
    kind = np.full(len(event_time), EventKind.CROSSING)
    kind[-1] = EventKind.FINISH
    passed = np.minimum(np.searchsorted(crossings, time, side="right"), len(crossings) - 1)
    return RaceLog(
        time=time,
        position_w=_part(limit, at, POSITION)[:, None],
        velocity_w=_part(limit, at, VELOCITY)[:, None],
        euler=_euler(limit, at)[:, None],
        action=_action(limit, at)[:, None],
        next_gate=(passed % len(gates)).astype(np.int32)[:, None],
        airborne=(time < crossings[-1])[:, None],
        **track_arrays(limit.track),
        event_time=event_time,
        event_drone=np.zeros(len(event_time), np.int32),
        event_kind=kind.astype(np.int32),
        event_gate=event_gate.astype(np.int32),
        event_other=np.full(len(event_time), NOBODY, np.int32),
        event_kind_names=np.array(EVENT_KINDS),
        pilots=np.array([PILOT]),
        vehicle=limit.vehicle.name,
        laps=max(1, (len(crossings) - 1) // len(gates)),
        control_dt=dt,
        collision_distance=limit.vehicle.collision_distance,
        collision_aspect=limit.vehicle.collision_aspect,
    )


def _part(limit: Limit, time: np.ndarray, part: slice) -> np.ndarray:
    """That part of the state at these times of the lap."""
    return between(time, limit.lap.clock, limit.lap.state[:, part]).astype(np.float32)


def _euler(limit: Limit, time: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw."""
    if limit.vehicle.flown_by == "cascade":
        return _part(limit, time, cascade.EULER)
    turns = Rotation.from_quat(limit.lap.state[:, ATTITUDE][:, [1, 2, 3, 0]])
    angles = np.unwrap(turns.as_euler("ZYX")[:, ::-1], axis=0)
    return np.unwrap(between(time, limit.lap.clock, angles), axis=0).astype(np.float32)  # of one lap after the other


def _action(limit: Limit, time: np.ndarray) -> np.ndarray:
    if limit.vehicle.flown_by == "rotors":
        return np.zeros((len(time), limit.vehicle.action.size), np.float32)
    step = np.searchsorted(limit.lap.clock, time, side="right") - 1
    return limit.lap.control[np.minimum(step, len(limit.lap.control) - 1)].astype(np.float32)
