"""A race whose every moment is known in closed form: drones on circles, at constant rates."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cruise.config import Gate, Pole, Track, Wall
from cruise.storage.race_log import EVENT_KINDS, EventKind, RaceLog
from cruise.storage.recorder import track_arrays
from tests.storage.logs import small_log

RADIUS, GATES = 8.0, 4  # gate k at angle k * 90 degrees, flown counter-clockwise


class Circler(NamedTuple):
    """A drone on a circle round the z axis."""

    start: float  # angle at time 0 [rad]
    rate: float  # [rad/s]
    radius: float
    height: float
    crash: float = np.inf  # when it hits the ground, as the log says [s]

    def position(self, t):
        """Where it is at times `t`, [..., 3]."""
        angle = self.start + self.rate * np.minimum(t, self.crash)
        flat = self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.concatenate([flat, np.full((*np.shape(angle), 1), self.height)], axis=-1)

    def velocity(self, t):
        """Its velocity at times `t`, [..., 3]."""
        x, y, _ = np.moveaxis(self.position(t), -1, 0)
        return self.rate * np.stack([-y, x, 0 * x], axis=-1)

    def crossings(self, until):
        """When it passes gates, from the first one at angle 0."""
        count = int((self.start + self.rate * min(until, self.crash)) // (np.pi / 2)) + 1
        times = (np.arange(max(count, 0)) * np.pi / 2 - self.start) / self.rate
        return times[times <= until]


# Drone 1 leads, drone 2 overtakes it, drone 3 crashes, drone 4 follows far behind.
FIELD = (
    Circler(-0.10, 0.50, 7.6, 3.0),
    Circler(-0.35, 0.62, 8.0, 3.4),
    Circler(-0.20, 0.45, 8.4, 2.6, crash=6.0),
    Circler(-0.50, 0.40, 8.2, 3.8),
)


def circle_race(field=FIELD, seconds=14.0, rate=10, laps=2, **changes) -> RaceLog:
    """The race as a log of `rate` samples a second."""
    time = np.arange(round(seconds * rate) + 1) / rate
    position = np.stack([drone.position(time) for drone in field], axis=1)
    velocity = np.stack([drone.velocity(time) for drone in field], axis=1)
    heading = np.arctan2(velocity[..., 1], velocity[..., 0])
    roll = np.full_like(heading, 0.3)
    shape = heading.shape
    crash = np.array([drone.crash for drone in field])
    angles = np.arange(GATES) * np.pi / 2
    flat = RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    fields = {
        "time": time,
        "position_w": position.astype(np.float32),
        "velocity_w": velocity.astype(np.float32),
        "euler": np.stack([roll, 0 * roll, heading], axis=-1).astype(np.float32),
        "action": np.zeros((*shape, 3), np.float32),
        "next_gate": np.zeros(shape, np.int32),
        "airborne": time[:, None] < crash,
        "gate_position": np.hstack([flat, np.full((GATES, 1), 3.0)]),
        "gate_yaw": angles + np.pi / 2,
        "gate_size": np.full((GATES, 2), 2.5),
        "bounds": np.array([[-15.0, -15.0, 0.0], [15.0, 15.0, 9.0]]),
        "pilots": np.array(["ace", "ace", "rookie", "<b>&amp;"][: len(field)]),
        "track": "circle",
        "laps": laps,
        "control_dt": 1 / rate,
    }
    return small_log(**fields | _events(field, seconds, laps) | changes)


def _events(field, seconds, laps):
    rows = []
    for drone, circler in enumerate(field):
        times = circler.crossings(seconds)[: laps * GATES + 1]
        rows += [(t, drone, EventKind.CROSSING, c % GATES) for c, t in enumerate(times)]
        if len(times) == laps * GATES + 1:
            rows.append((times[-1], drone, EventKind.FINISH, 0))
        if circler.crash <= seconds:
            rows.append((circler.crash, drone, EventKind.COLLISION_GROUND, -1))
    rows.sort()
    time, drone, kind, gate = zip(*rows, strict=True)
    columns = {"event_drone": drone, "event_kind": kind, "event_gate": gate, "event_other": [-1] * len(rows)}
    return {
        "event_time": np.array(time),
        "event_kind_names": np.array(EVENT_KINDS),
        **{name: np.array(values, np.int32) for name, values in columns.items()},
    }


LEANING = (
    Gate((8.0, 0.0, 3.0), np.pi / 2, 2.5, 2.5, roll=0.4),
    Gate((0.0, 8.0, 3.0), np.pi, 2.5, 2.5, pitch=0.6, shape="round"),
    Gate((-8.0, 0.0, 3.0), -np.pi / 2, 2.5, 2.5, shape="round"),
    Gate((0.0, -8.0, 3.0), 0.0, 2.5, 2.5, pitch=-0.9),
)
SOLIDS = (
    Pole((3.0, 3.0, 0.0), 6.0, 0.15),
    Pole((-4.0, 2.0, 0.0), 3.0, 0.6),
    Wall((0.0, 0.0, 1.5), (6.0, 0.3, 3.0), 0.5),
)


def solid_race(away=(0.0, 0.0, 0.0), **changes) -> RaceLog:
    """The same race through leaning and round gates among poles and walls, all of it so far away [m]."""
    away = np.array(away)
    gates = tuple(replace(gate, position_w=tuple((away + gate.position_w).tolist())) for gate in LEANING)
    poles = tuple(replace(pole, base_w=tuple((away + pole.base_w).tolist())) for pole in SOLIDS[:2])
    wall = replace(SOLIDS[2], position_w=tuple((away + SOLIDS[2].position_w).tolist()))
    track = Track("solid", gates, (-15.0, -15.0, 0.0), (15.0, 15.0, 9.0), obstacles=(*poles, wall))
    race = circle_race()
    position = (race.position_w + away).astype(np.float32)
    return replace(race, **track_arrays(track) | {"position_w": position} | changes)
