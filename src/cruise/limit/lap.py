"""The time-optimal lap of a vehicle on a track, and what there is to say about it."""

import itertools
import math
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.interpolate import CubicHermiteSpline

from cruise.config import Track, Vehicle
from cruise.errors import CruiseError
from cruise.limit import guess
from cruise.limit.keep_out import solids_struck
from cruise.limit.models import POSITION, VELOCITY, make_model, point_mass
from cruise.limit.search import fastest
from cruise.limit.stepped import LARGEST_CHANGE, SteppedLap, SteppedProblem
from cruise.limit.transcription import Dash, Lap, Problem, first_found, stops
from cruise.racing.course import make_course
from cruise.racing.gates import PlaneCrossing, cross_plane
from cruise.racing.motion import must_stand_still
from cruise.racing.track_geometry import lap_length, segment_lengths

MAX_LAPS = 10  # as one programme
MAX_GATES = 60  # of a dash
SHORTEST = 1e-3  # from gate to gate [m]
STEPS = 20  # from gate to gate, in each of which a control is held
LOOKS = 4000  # places of a line that are compared with the solids
FIRST_SPEEDS = (4.0, 8.0, 2.0)  # of the line that the search starts with, tried in turn [m/s]


@dataclass(frozen=True)
class Limit:
    """The fastest way found around a track."""

    track: Track
    vehicle: Vehicle
    equations: str  # of the vehicle, in a word or two
    lap: Lap | SteppedLap
    standing_laps: int  # 0: periodic flight
    dash: Dash | None = None  # in place of laps
    ball: float | None = None  # within which gates were passed [m]

    @property
    def lap_times(self) -> tuple[float, ...]:
        """One per lap, or that of a dash [s]."""
        if self.dash is not None:
            return (self.lap.time,)
        per_lap = self.lap.duration.reshape(-1, len(self.track.gates))
        return tuple(float(time) for time in per_lap.sum(axis=1))

    @property
    def nominal_speed(self) -> float:
        """Length of the polygon through the gates per time of the last lap, or of a dash [m/s]."""
        if self.dash is None:
            return lap_length(self.track.gates) / self.lap_times[-1]
        places = [gate.position_w for gate in stops(self.track, dash=self.dash)]
        return sum(itertools.starmap(math.dist, itertools.pairwise(places))) / self.lap.time

    @property
    def mean_speed(self) -> float:
        """Along the line flown, over time [m/s]."""
        speeds = np.linalg.norm(self.lap.state[:, VELOCITY], axis=1)
        return float(np.trapezoid(speeds, self.lap.clock) / self.lap.time)

    @property
    def frames_struck(self) -> tuple[int, ...]:
        """Gates whose frame the line runs through on its way to another gate, which the optimiser does not know of."""
        if self.ball is not None:
            return ()
        course, line = make_course(self.track), jnp.asarray(self.lap.state[:, POSITION].T, jnp.float32)
        crossings = (cross_plane(course, gate, line[:, :-1], line[:, 1:]) for gate in range(course.num_gates))
        return tuple(gate for gate, crossing in enumerate(crossings) if bool(_on_frame(crossing, self.track).any()))

    @property
    def solids_struck(self) -> tuple[int, ...]:
        """Obstacles of the track that the line runs through between the places where the optimiser looked."""
        times = np.linspace(0.0, self.lap.time, LOOKS)
        line = CubicHermiteSpline(self.lap.clock, self.lap.state[:, POSITION], self.lap.state[:, VELOCITY])(times)
        return solids_struck(self.track, line)

    @property
    def top_speed(self) -> float:
        """[m/s]."""
        return float(np.linalg.norm(self.lap.state[:, VELOCITY], axis=1).max())


def _on_frame(crossing: PlaneCrossing, track: Track) -> Array:
    through = crossing.ahead | crossing.back
    return through & (crossing.offset > 0) & (crossing.offset <= track.frame_width)


@dataclass(frozen=True)
class Options:
    """How a limit is sought. Which of the last two counts is the vehicle's to say; the other must be None."""

    margin: float = 0.25  # kept from the edges of every opening, and from poles and walls [m]
    standing_laps: int = 0  # from hovering in the middle of gate 0; 0 for one lap in periodic flight
    dash: Dash | None = None  # in place of laps, from a place through some gates; for vehicles with rotors
    ball: float | None = None  # pass gates within so much of their centres in place of their openings; likewise [m]
    steps: int | None = None  # of a vehicle flown by thrust and body rates, from gate to gate; None for STEPS
    largest_change: float | None = None  # of an action between the steps that a controller flies in; None for any


def find_limit(track: Track, vehicle: Vehicle, options: Options | None = None) -> Limit:
    """The time-optimal flight of one drone alone.

    Raises:
        CruiseError: for options that cannot be, or where the solver finds nothing.
    """
    options = options or Options()
    _check(track, vehicle, options)
    return _stepped(track, vehicle, options) if vehicle.flown_by == "cascade" else _smooth(track, vehicle, options)


def _smooth(track: Track, vehicle: Vehicle, options: Options) -> Limit:
    """A point mass of the same thrust first, which starts the vehicle."""
    assert vehicle.airframe is not None
    drag = vehicle.airframe.drag.horizontal / vehicle.mass
    point = point_mass(vehicle.agility, vehicle.gravity, drag)
    problem = Problem(track, point, options.margin, options.standing_laps, options.dash, options.ball)
    first = _from_scratch(problem, options.steps or STEPS)
    model = make_model(vehicle)
    lap = replace(problem, model=model).solve(guess.from_point_mass(first, model, vehicle.gravity))
    return Limit(track, vehicle, model.name, lap, options.standing_laps, options.dash, options.ball)


def _stepped(track: Track, vehicle: Vehicle, options: Options) -> Limit:
    """The vehicle's own controller, whose commands the optimiser chooses."""
    change = LARGEST_CHANGE if options.largest_change is None else options.largest_change
    problem = SteppedProblem(track, vehicle, options.margin, options.standing_laps, change)
    found = fastest(problem)
    return Limit(track, vehicle, f"steps of {found.length:.4f} s", problem.lap(found), options.standing_laps)


def _check(track: Track, vehicle: Vehicle, options: Options) -> None:
    must_stand_still(track, "the limit is known for")
    widest = min(gate.width if gate.shape == "round" else min(gate.width, gate.height) for gate in track.gates) / 2
    if min(segment_lengths(track.gates)) < SHORTEST:
        raise CruiseError(
            f"{track.name} has a gate that follows itself in one place: the fastest lap there only flies to and fro "
            "through its opening"
        )
    margin, steps, change = options.margin, options.steps, options.largest_change
    if not (math.isfinite(margin) and 0 <= margin < widest):
        raise CruiseError(f"margin must be from 0 to less than {widest:g} m, half the smallest opening, not {margin}")
    if not 0 <= options.standing_laps <= MAX_LAPS:
        raise CruiseError(f"laps from standing must be from 1 to {MAX_LAPS}, not {options.standing_laps}")
    _check_dash(track, vehicle, options)
    if vehicle.flown_by == "cascade" and steps is not None:
        raise CruiseError(f"steps are not to be chosen for {vehicle.name!r}: its own are {vehicle.control_dt:g} s long")
    if vehicle.flown_by == "cascade" and (vehicle.integrator, vehicle.substeps) != ("euler", 1):
        raise CruiseError(f"the limit of {vehicle.name!r} is known only with single steps of the explicit Euler method")
    if vehicle.flown_by == "rotors" and change is not None:
        raise CruiseError(f"the largest change of an action says nothing of {vehicle.name!r}, which has no steps")
    if not 5 <= (steps or STEPS) <= 200:
        raise CruiseError(f"steps must be from 5 to 200, not {steps}")
    if change is not None and not 0 < change <= LARGEST_CHANGE:
        raise CruiseError(f"largest change of an action must be above 0 and at most {LARGEST_CHANGE:g}, not {change}")


def _check_dash(track: Track, vehicle: Vehicle, options: Options) -> None:
    dash, ball = options.dash, options.ball
    if vehicle.flown_by == "cascade" and not (dash is None and ball is None):
        raise CruiseError(f"a dash and balls are known for vehicles with rotors, and {vehicle.name!r} has none")
    if ball is not None and not (math.isfinite(ball) and ball > 0):
        raise CruiseError(f"the radius of balls must be above 0, not {ball}")
    if dash is None:
        return
    if options.standing_laps:
        raise CruiseError("a flight is laps from standing or a dash from a place: ask for one of them")
    if not 1 <= dash.gates <= MAX_GATES:
        raise CruiseError(f"a dash is through 1 to {MAX_GATES} gates, not {dash.gates}")
    inside = (low <= x <= high for low, x, high in zip(track.bounds_low, dash.start_w, track.bounds_high, strict=True))
    if not all(inside):
        raise CruiseError(f"a dash must start within the bounds of {track.name}, not at {dash.start_w}")


def _from_scratch(problem: Problem, steps: int) -> Lap:
    """The first of several smooth lines that leads to a lap."""

    def solved(speed: float) -> Lap:
        return problem.solve(guess.line(problem, speed, steps))

    return first_found(solved, FIRST_SPEEDS)
