"""Where the optimiser starts: a smooth line through the gates, and an attitude for what it accelerates."""

import itertools

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from cruise.config import Gate, Track
from cruise.limit.models import ATTITUDE, POSITION, VELOCITY, Model
from cruise.limit.transcription import Dash, Lap, Problem, stops
from cruise.racing.detours import site_of
from cruise.racing.ways import normal_of, way_around

KNOTS = 9  # of a way around solids, its ends included


def spline(
    track: Track, speed: float, laps: int = 1, dash: Dash | None = None
) -> tuple[np.ndarray, CubicHermiteSpline]:
    """Times from gate to gate [s], and a line along each gate's normal through its middle at `speed` [m/s].

    Where poles and walls stand on a track the line is the way around them.
    """
    legs = [_leg(track, a, b) for a, b in itertools.pairwise(stops(track, laps, dash))]
    length = [np.linalg.norm(np.diff(places, axis=0), axis=1) for places, _ in legs]
    times = np.concatenate([[0.0], np.cumsum(np.concatenate(length) / speed)])
    places, tangents = (np.concatenate([legs[0][k][:1], *(leg[k][1:] for leg in legs)]) for k in (0, 1))
    duration = np.array([one.sum() for one in length]) / speed
    return duration, CubicHermiteSpline(times, places, speed * tangents)


def _leg(track: Track, a: Gate, b: Gate) -> tuple[np.ndarray, np.ndarray]:
    """Places [K, 3] and directions of flight [K, 3] from one gate to the next, both included."""
    if track.obstacles:
        way = way_around(site_of(track), a, b, track.frame_width)
        knots = np.linspace(0, len(way.point_w) - 1, KNOTS).astype(int)
        return way.point_w[knots], way.tangent_w[knots]
    return np.array([a.position_w, b.position_w]), np.array([normal_of(a), normal_of(b)])


def line(problem: Problem, speed: float, steps: int) -> Lap:
    """The spline flown level, cut into so many steps from gate to gate."""
    model = problem.model
    duration, path = spline(problem.track, speed, problem.standing_laps or 1, problem.dash)
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
