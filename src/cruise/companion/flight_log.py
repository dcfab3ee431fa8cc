"""A flight of a real drone as a race log: the replay page, the metrics and identification take it."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from cruise.companion.flight import Sample
from cruise.companion.policy import OnnxPolicy
from cruise.errors import CruiseError
from cruise.racing.events import EVENT_KINDS, EventKind
from cruise.storage.race_log import NOBODY, RaceLog
from cruise.storage.recorder import track_arrays


def log_of(samples: Sequence[Sample], policy: OnnxPolicy) -> RaceLog:
    """The flight from its first command on. Raises CruiseError where there was none."""
    if not samples:
        raise CruiseError("nothing was flown: there is no log to write")
    time = np.array([sample.time for sample in samples]) - samples[0].time
    gates = np.array([sample.next_gate for sample in samples], np.int32)
    passed = np.flatnonzero(np.diff(gates)) + 1
    attitude = np.roll([sample.state.attitude for sample in samples], -1, axis=1)
    euler = Rotation.from_quat(attitude).as_euler("ZYX")[:, ::-1]
    vehicle, none = policy.vehicle, np.zeros(len(passed), np.int32)
    return RaceLog(
        time=time.astype(np.float32),
        position_w=_alone([sample.state.position_w for sample in samples]),
        velocity_w=_alone([sample.state.velocity_w for sample in samples]),
        euler=_alone(euler),
        action=_alone([sample.action for sample in samples]),
        next_gate=gates[:, None],
        airborne=np.ones((len(samples), 1), bool),
        **track_arrays(policy.track),
        event_time=time[passed].astype(np.float32),
        event_drone=none,
        event_kind=none + EVENT_KINDS.index(EventKind.CROSSING.stored),
        event_gate=gates[passed - 1],
        event_other=none + NOBODY,
        event_kind_names=np.array(EVENT_KINDS),
        pilots=np.array([policy.name]),
        vehicle=vehicle.name,
        laps=policy.track.laps,
        control_dt=policy.control_dt,
        collision_distance=vehicle.collision_distance,
        collision_aspect=vehicle.collision_aspect,
    )


def _alone(rows: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """[T, 3] of the only drone as [T, 1, 3]."""
    return np.asarray(rows, np.float32)[:, None]
