"""A time-optimal flight as a race log, which the replay shows as it shows any other, or as a ghost."""

import numpy as np
from scipy.spatial.transform import Rotation

from cruise.limit.lap import Limit
from cruise.limit.models import ATTITUDE, POSITION, VELOCITY
from cruise.limit.transcription import Lap
from cruise.storage.race_log import EVENT_KINDS, NOBODY, EventKind, RaceLog
from cruise.storage.recorder import track_arrays

PILOT = "limit"


def limit_log(limit: Limit, laps: int = 1) -> RaceLog:
    """Its flight, sampled as the vehicle's other races are; a lap in periodic flight is repeated `laps` times.

    The clock starts in the plane of gate 0. Actions are not known and zero.
    """
    lap = limit.lap if limit.standing_laps else repeated(limit.lap, laps)
    dt, gates = limit.vehicle.control_dt, limit.track.gates
    time = np.arange(int(np.ceil(lap.time / dt - 1e-9)) + 1) * dt
    position, velocity, euler = (sampled(lap, time, part) for part in (POSITION, VELOCITY, ATTITUDE))
    crossings = np.concatenate([[0.0], np.cumsum(lap.duration)])
    gate = np.arange(len(crossings)) % len(gates)
    event_time, event_gate = np.append(crossings, crossings[-1]), np.append(gate, gate[-1])
    kind = np.full(len(event_time), EventKind.CROSSING)
    kind[-1] = EventKind.FINISH
    passed = np.minimum(np.searchsorted(crossings, time, side="right"), len(crossings) - 1)
    return RaceLog(
        time=time,
        position_w=position[:, None],
        velocity_w=velocity[:, None],
        euler=euler[:, None],
        action=np.zeros((len(time), 1, 4), np.float32),
        next_gate=(passed % len(gates)).astype(np.int32)[:, None],
        airborne=(time < lap.time)[:, None],
        **track_arrays(limit.track),
        event_time=event_time,
        event_drone=np.zeros(len(event_time), np.int32),
        event_kind=kind.astype(np.int32),
        event_gate=event_gate.astype(np.int32),
        event_other=np.full(len(event_time), NOBODY, np.int32),
        event_kind_names=np.array(EVENT_KINDS),
        pilots=np.array([PILOT]),
        vehicle=limit.vehicle.name,
        laps=len(lap.duration) // len(gates),
        control_dt=dt,
        collision_distance=limit.vehicle.collision_distance,
        collision_aspect=limit.vehicle.collision_aspect,
    )


def repeated(lap: Lap, laps: int) -> Lap:
    """A lap in periodic flight, flown several times."""
    state = np.concatenate([np.tile(lap.state[:-1], (laps, 1)), lap.state[-1:]])
    return Lap(np.tile(lap.duration, laps), state, np.tile(lap.control, (laps, 1)))


def sampled(lap: Lap, time: np.ndarray, part: slice) -> np.ndarray:
    """Position, velocity or, of the attitude, roll, pitch and yaw, between the states by straight lines."""
    values = lap.state[:, part]
    if part == ATTITUDE:
        turns = Rotation.from_quat(values[:, [1, 2, 3, 0]])
        values = np.unwrap(turns.as_euler("ZYX")[:, ::-1], axis=0)
    between = np.stack([np.interp(time, lap.clock, column) for column in values.T], axis=1)
    return np.asarray(between, np.float32)
