"""Where the optimiser starts: a smooth line through the gates, and an attitude for what it accelerates."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from cruise.config import Track
from cruise.limit.models import ATTITUDE, POSITION, VELOCITY, Model
from cruise.limit.transcription import Lap


def spline(track: Track, speed: float, laps: int = 1) -> tuple[np.ndarray, CubicHermiteSpline]:
    """Times from gate to gate [s], and a line along each gate's normal through its middle at `speed` [m/s]."""
    gates = [*track.gates * laps, track.gates[0]]
    places, yaw = np.array([gate.position_w for gate in gates]), np.array([gate.yaw for gate in gates])
    duration = np.linalg.norm(np.diff(places, axis=0), axis=1) / speed
    times = np.concatenate([[0.0], np.cumsum(duration)])
    slopes = speed * np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1)
    return duration, CubicHermiteSpline(times, places, slopes)


def line(track: Track, model: Model, speed: float, steps: int, laps: int = 1) -> Lap:
    """The spline flown level, cut into so many steps from gate to gate."""
    duration, path = spline(track, speed, laps)
    lap = Lap(duration, np.zeros((len(duration) * steps + 1, 0)), np.zeros((len(duration) * steps, 0)))
    state = np.tile(model.hover, (len(lap.clock), 1))
    state[:, POSITION], state[:, VELOCITY] = path(lap.clock), path(lap.clock, 1)
    return Lap(duration, state, np.tile(model.lift, (len(state) - 1, 1)))


def attitude_of(force: np.ndarray) -> np.ndarray:
    """The shortest turn [T, 4] from upright to a thrust [T, 3]."""
    x, y, z = (force / np.linalg.norm(force, axis=1, keepdims=True)).T
    quaternion = np.stack([1 + z, -y, x, np.zeros_like(z)], axis=1)
    return quaternion / np.maximum(np.linalg.norm(quaternion, axis=1, keepdims=True), 1e-6)


def from_point_mass(lap: Lap, model: Model, gravity: float) -> Lap:
    """The lap of a point mass, whose controls are thrusts per mass, as a start for a vehicle.

    States behind the attitude that do not vanish when it hovers are thrusts, as are such controls.
    """
    force = lap.control[np.r_[0 : len(lap.control), -1]]
    share = np.linalg.norm(force, axis=1, keepdims=True) / gravity
    state = model.hover * share
    state[:, : VELOCITY.stop] = lap.state
    state[:, ATTITUDE] = attitude_of(force)
    return Lap(lap.duration, state, model.lift * share[:-1])
