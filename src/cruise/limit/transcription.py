"""A time-optimal lap as a nonlinear programme: direct multiple shooting, a stretch of equal steps from gate to gate."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import casadi as ca
import numpy as np

from cruise import geometry
from cruise.config import Gate, Track, Vec3
from cruise.errors import CruiseError
from cruise.limit import keep_out
from cruise.limit.models import ATTITUDE, POSITION, VELOCITY, Model, Range

Condition = tuple[ca.MX, Range]  # an expression, and within which bounds it must lie
Found = TypeVar("Found")
SMOOTH = 1e-5  # weight of the controls' squared changes, over their range: picks one of many equal optima
SLOWEST = 0.2  # least speed through a gate along its normal [m/s]


@dataclass(frozen=True)
class Lap:
    """From gate to gate: K steps, equally long within a stretch, each with a control held."""

    duration: np.ndarray  # [S] of the stretches [s]
    state: np.ndarray  # [S K + 1, X] at the ends of the steps
    control: np.ndarray  # [S K, U]

    @property
    def time(self) -> float:
        """Of the whole lap [s]."""
        return float(self.duration.sum())

    @property
    def steps(self) -> int:
        """K."""
        return len(self.control) // len(self.duration)

    @property
    def clock(self) -> np.ndarray:
        """Times of the states [s], [S K + 1]."""
        return np.concatenate([[0.0], np.cumsum(np.repeat(self.duration / self.steps, self.steps))])


class Dash(NamedTuple):
    """From hovering at a place through so many gates, gate 0 first and round again, to a free end or to a stop."""

    start_w: Vec3  # [m]
    gates: int
    stop: bool = False  # hovering in the middle of the last gate


def stops(track: Track, laps: int = 1, dash: Dash | None = None) -> list[Gate]:
    """The gates from which and to which every stretch of a flight leads; before a dash a gate stands at its start."""
    gates = track.gates
    if dash is None:
        return [*gates * laps, gates[0]]
    (x, y, _), (to_x, to_y, _) = dash.start_w, gates[0].position_w
    start = Gate(dash.start_w, math.atan2(to_y - y, to_x - x))
    return [start, *(gates[s % len(gates)] for s in range(dash.gates))]


class _Unknowns(NamedTuple):
    durations: ca.MX  # [S]
    states: ca.MX  # [X, S K + 1]
    controls: ca.MX  # [U, S K]


def _unknowns(model: Model, stretches: int, steps: int) -> _Unknowns:
    nodes = stretches * steps
    return _Unknowns(
        ca.MX.sym("T", stretches),
        ca.MX.sym("x", model.state_size, nodes + 1),
        ca.MX.sym("u", len(model.control[0]), nodes),
    )


def _step_lengths(unknown: _Unknowns) -> ca.MX:
    """[1, S K] of every step [s]."""
    nodes, stretches = unknown.controls.shape[1], unknown.durations.numel()
    steps = nodes // stretches
    return ca.repmat((unknown.durations / steps).T, steps, 1).reshape((1, nodes))


def _unpacked(numbers: np.ndarray, like: Lap) -> Lap:
    """The numbers of a lap, which lie behind each other, in its shapes."""
    first, last = like.duration.size, numbers.size - like.control.size
    duration, state, control = numbers[:first], numbers[first:last], numbers[last:]
    return Lap(duration, state.reshape(like.state.shape), control.reshape(like.control.shape))


@dataclass(frozen=True)
class Problem:
    """Laps of a track, from gate 0 to gate 0: one in periodic flight, or some from standing; or a dash."""

    track: Track
    model: Model
    margin: float = 0.25  # kept from the edges of every opening, and from poles and walls [m]
    standing_laps: int = 0  # from hovering in the middle of gate 0, so many laps to a free end; 0: one lap for ever
    dash: Dash | None = None  # in place of laps
    ball: float | None = None  # gates are passed within so much of their centres, whatever their openings [m]

    @property
    def stops(self) -> list[Gate]:
        """As the function of this name."""
        return stops(self.track, self.standing_laps or 1, self.dash)

    @property
    def from_rest(self) -> bool:
        """Whether the flight begins hovering, and its end is free."""
        return self.dash is not None or self.standing_laps > 0

    @property
    def _stops(self) -> bool:
        return self.dash is not None and self.dash.stop

    def solve(self, guess: Lap) -> Lap:
        """The fastest lap near the guess, in as many steps. Raises CruiseError where the solver finds none."""
        unknown = _unknowns(self.model, len(guess.duration), guess.steps)
        conditions = [
            *self._motion(unknown),
            *self._ends(unknown.states),
            *self._gates(unknown),
            *self._solids(unknown),
        ]
        span = self.model.control[1] - self.model.control[0]
        change = (unknown.controls[:, 1:] - unknown.controls[:, :-1]) / span
        objective = ca.sum1(unknown.durations) + SMOOTH * ca.sumsqr(change)
        start = np.concatenate([guess.duration, guess.state.ravel(), guess.control.ravel()])
        bounds = self._bounds(len(guess.duration), len(guess.control))
        try:
            found = minimised(objective, ca.veccat(*unknown), conditions, start, bounds)
        except CruiseError as error:
            raise CruiseError(f"no fastest lap of {self.track.name} by {self.model.name} found: {error}") from error
        return _unpacked(found, guess)

    def _motion(self, unknown: _Unknowns) -> list[Condition]:
        """Every step ends where the next begins, and what holds along the path holds at its start."""
        nodes, step = unknown.controls.shape[1], _step_lengths(unknown)
        starts, ends = unknown.states[:, :-1], unknown.states[:, 1:]
        gap = shooting(self.model).map(nodes)(starts, unknown.controls, step) - ends
        if self.model.path is None:
            return [(gap, zeros(gap))]
        low, high = self.model.path_range
        along = _function(self.model, self.model.path).map(nodes)(starts, unknown.controls)
        return [(gap, zeros(gap)), (along, (np.tile(low, nodes), np.tile(high, nodes)))]

    def _gates(self, unknown: _Unknowns) -> list[Condition]:
        """Every stretch ends in the gate that it leads to."""
        steps = unknown.controls.shape[1] // unknown.durations.numel()
        conditions = []
        for s, gate in enumerate(self.stops[1:], start=1):
            position, velocity = (unknown.states[part, s * steps] for part in (POSITION, VELOCITY))
            if self._stops and s == len(self.stops) - 1:
                continue  # `_bounds` has it there
            if self.ball is None:
                conditions.append(through(gate, self.margin, position, velocity))
            else:
                near = ca.sumsqr(position - ca.DM(list(gate.position_w)))
                conditions.append((near, (np.zeros(1), np.full(1, self.ball**2))))
        return conditions

    def _solids(self, unknown: _Unknowns) -> list[Condition]:
        """The margin from poles and walls, at the ends of steps and between them."""
        starts, ends = unknown.states[:, :-1], unknown.states[:, 1:]
        velocities = starts[VELOCITY, :], ends[VELOCITY, :]
        line = keep_out.curve(starts[POSITION, :], ends[POSITION, :], velocities, _step_lengths(unknown))
        return keep_out.beyond(self.track, self.margin, line)

    def _ends(self, states: ca.MX) -> list[Condition]:
        """What joins the end of the lap with its start."""
        first, last = states[:, 0], states[:, -1]
        if self.from_rest:
            return []
        apart = last - first
        joined = [apart[:6]]
        if self.model.has_attitude:
            # Four components of a unit quaternion that are equal are three conditions: the turn between them is none.
            turn = _between(first[ATTITUDE], last[ATTITUDE])
            joined += [turn, apart[10:], ca.sumsqr(first[ATTITUDE]) - 1]
        return [(condition, zeros(condition)) for condition in joined]

    def _bounds(self, stretches: int, nodes: int) -> Range:
        low, high = (np.tile(bound, (nodes + 1, 1)) for bound in self.model.state)
        low[:, POSITION], high[:, POSITION] = self.track.bounds_low, self.track.bounds_high
        if self.from_rest:
            low[0] = high[0] = start_of(self.stops[0], self.model)
        if self._stops:
            end = start_of(self.stops[-1], self.model)
            fixed = [*range(6), *([7, 8, 10, 11, 12] if self.model.has_attitude else [])]  # whatever its heading
            low[-1, fixed] = high[-1, fixed] = end[fixed]
        control = [np.tile(bound, nodes) for bound in self.model.control]
        time = np.full(stretches, 0.05), np.full(stretches, 30.0)
        return (
            np.concatenate([time[0], low.ravel(), control[0]]),
            np.concatenate([time[1], high.ravel(), control[1]]),
        )


_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 2000, "tol": 1e-6, "acceptable_tol": 1e-4},
}


def minimised(objective: ca.MX, unknown: ca.MX, conditions: list[Condition], start: np.ndarray, bounds: Range) -> Any:
    """The unknowns at a minimum near the start. Raises CruiseError where IPOPT finds none."""
    programme = {"x": unknown, "f": objective, "g": ca.veccat(*(condition for condition, _ in conditions))}
    solver = ca.nlpsol("lap", "ipopt", programme, _OPTIONS)
    low, high = (np.concatenate([within[side] for _, within in conditions]) for side in (0, 1))
    found = solver(x0=start, lbx=bounds[0], ubx=bounds[1], lbg=low, ubg=high)
    status = solver.stats()["return_status"]
    if status not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
        raise CruiseError(f"IPOPT says {status}")
    return np.array(found["x"]).ravel()


def first_found(solve: Callable[[float], Found], values: Iterable[float]) -> Found:
    """What the first value with a solution leads to. Raises the last CruiseError where none has one."""
    fault = CruiseError("nothing to try")
    for value in values:
        try:
            return solve(value)
        except CruiseError as error:
            fault = error
    raise fault


def between(new: np.ndarray, old: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Rows of `values`, which belong to the times `old`, at the times `new` by straight lines, [N, X]."""
    return np.stack([np.interp(new, old, column) for column in values.T], axis=1)


def start_of(gate: Gate, model: Model) -> np.ndarray:
    """Hovering in the middle of a gate."""
    state = model.hover.copy()
    state[POSITION] = gate.position_w
    return state


def through(gate: Gate, margin: float, position: ca.MX, velocity: ca.MX) -> Condition:
    """On the plane of a gate, inside its opening with the margin, in the direction of flight."""
    frame = geometry.heading_of(gate.yaw), geometry.tilt_of(gate.roll, gate.pitch)
    forward, left, up = geometry.to_gate(frame[0], position - ca.DM(list(gate.position_w)), frame[1])
    speed, _, _ = geometry.to_gate(frame[0], velocity, frame[1])
    half_width, half_height = gate.width / 2 - margin, gate.height / 2 - margin
    if gate.shape == "round":
        low, high = np.array([0.0, -np.inf, SLOWEST]), np.array([0.0, half_width**2, np.inf])
        rows: list[ca.MX] = [forward, left * left + up * up, speed]
        return ca.vertcat(*rows), (low, high)
    low, high = np.array([0.0, -half_width, -half_height, SLOWEST]), np.array([0.0, half_width, half_height, np.inf])
    rows = [forward, left, up, speed]
    return ca.vertcat(*rows), (low, high)


def shooting(model: Model) -> ca.Function:
    """One step of the classical Runge-Kutta method, after which a quaternion has unit length again."""
    x, u, h = ca.SX.sym("x", model.state_size), ca.SX.sym("u", len(model.control[0])), ca.SX.sym("h")
    k1 = model.derivative(x, u)
    k2 = model.derivative(x + h / 2 * k1, u)
    k3 = model.derivative(x + h / 2 * k2, u)
    k4 = model.derivative(x + h * k3, u)
    end = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    if model.has_attitude:
        end[ATTITUDE] /= ca.norm_2(end[ATTITUDE])
    return ca.Function("step", [x, u, h], [end])


def _function(model: Model, expression: Callable[[ca.SX, ca.SX], ca.SX]) -> ca.Function:
    x, u = ca.SX.sym("x", model.state_size), ca.SX.sym("u", len(model.control[0]))
    return ca.Function("path", [x, u], [expression(x, u)])


def _between(a: ca.MX, b: ca.MX) -> ca.MX:
    """Vector part of the quaternion conj(a) b."""
    return a[0] * b[1:4] - b[0] * a[1:4] - ca.cross(a[1:4], b[1:4])


def zeros(like: ca.MX) -> Range:
    """Bounds of a condition that is an equation."""
    return np.zeros(like.numel()), np.zeros(like.numel())
