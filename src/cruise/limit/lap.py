"""The time-optimal lap of a vehicle on a track, and what there is to say about it."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.config import Track, Vehicle
from cruise.errors import CruiseError
from cruise.limit import guess
from cruise.limit.models import POSITION, VELOCITY, Model, make_model, point_mass
from cruise.limit.transcription import Lap, Problem
from cruise.racing.course import make_course
from cruise.racing.gates import PlaneCrossing, cross_plane
from cruise.racing.track_geometry import lap_length

MAX_LAPS = 10  # as one programme
FIRST_SPEEDS = (4.0, 8.0, 2.0)  # of the line that the search starts with, tried in turn [m/s]


@dataclass(frozen=True)
class Limit:
    """The fastest way found around a track."""

    track: Track
    vehicle: Vehicle
    model: Model
    lap: Lap
    standing_laps: int  # 0: periodic flight

    @property
    def lap_times(self) -> tuple[float, ...]:
        """One per lap [s]."""
        per_lap = self.lap.duration.reshape(-1, len(self.track.gates))
        return tuple(float(time) for time in per_lap.sum(axis=1))

    @property
    def nominal_speed(self) -> float:
        """Length of the polygon through the gates per time of the last lap [m/s]."""
        return lap_length(self.track.gates) / self.lap_times[-1]

    @property
    def mean_speed(self) -> float:
        """Along the line flown, over time [m/s]."""
        speeds = np.linalg.norm(self.lap.state[:, VELOCITY], axis=1)
        return float(np.trapezoid(speeds, self.lap.clock) / self.lap.time)

    @property
    def frames_struck(self) -> tuple[int, ...]:
        """Gates whose frame the line runs through on its way to another gate, which the optimiser does not know of."""
        course, line = make_course(self.track), jnp.asarray(self.lap.state[:, POSITION].T, jnp.float32)
        crossings = (cross_plane(course, gate, line[:, :-1], line[:, 1:]) for gate in range(course.num_gates))
        return tuple(gate for gate, crossing in enumerate(crossings) if bool(_on_frame(crossing, self.track).any()))

    @property
    def top_speed(self) -> float:
        """[m/s]."""
        return float(np.linalg.norm(self.lap.state[:, VELOCITY], axis=1).max())


def _on_frame(crossing: PlaneCrossing, track: Track) -> Array:
    through = crossing.ahead | crossing.back
    return through & (crossing.offset > 0) & (crossing.offset <= track.frame_width)


def find_limit(track: Track, vehicle: Vehicle, margin: float = 0.25, standing_laps: int = 0, steps: int = 20) -> Limit:
    """The time-optimal flight of one drone alone: a point mass of the same thrust first, which starts the vehicle.

    Args:
        track: to be flown.
        vehicle: one that is flown by thrust and body rates.
        margin: kept from the edges of every opening [m].
        standing_laps: from hovering in the middle of gate 0; 0 for one lap in periodic flight.
        steps: from gate to gate, in each of which a control is held.

    Raises:
        CruiseError: for a vehicle or margin that cannot be, or where the solver finds nothing.
    """
    if vehicle.airframe is None:
        raise CruiseError(
            f"no equations for the limit of vehicle {vehicle.name!r}, which its controller flies in steps of "
            f"{vehicle.control_dt:g} s; choose one that is flown by thrust and body rates (cruise vehicles)"
        )
    _check(track, margin, standing_laps, steps)
    drag = vehicle.airframe.drag.horizontal / vehicle.mass
    point = point_mass(vehicle.agility, vehicle.gravity, drag)
    first = _from_scratch(Problem(track, point, margin, standing_laps), steps)
    model = make_model(vehicle)
    lap = Problem(track, model, margin, standing_laps).solve(guess.from_point_mass(first, model, vehicle.gravity))
    return Limit(track, vehicle, model, lap, standing_laps)


def _check(track: Track, margin: float, standing_laps: int, steps: int) -> None:
    widest = min(min(gate.width, gate.height) for gate in track.gates) / 2
    if not (math.isfinite(margin) and 0 <= margin < widest):
        raise CruiseError(f"margin must be from 0 to less than {widest:g} m, half the smallest opening, not {margin}")
    if not 0 <= standing_laps <= MAX_LAPS:
        raise CruiseError(f"laps from standing must be from 1 to {MAX_LAPS}, not {standing_laps}")
    if not 5 <= steps <= 200:
        raise CruiseError(f"steps must be from 5 to 200, not {steps}")


def _from_scratch(problem: Problem, steps: int) -> Lap:
    """The first of several smooth lines that leads to a lap."""
    for speed in FIRST_SPEEDS:
        try:
            return problem.solve(guess.line(problem.track, problem.model, speed, steps, problem.standing_laps or 1))
        except CruiseError as error:
            fault = error
    raise fault
