"""A time-optimal lap of a vehicle whose controller flies it in steps of a fixed length, as a nonlinear programme.

A gate lies somewhere within a step, on the straight line that an Euler step is: in which step is given, where in it is
an unknown. Which step suits, and how many a lap takes, is `cruise.limit.search`'s to find.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from cruise.config import Track, Vehicle
from cruise.errors import CruiseError
from cruise.limit import keep_out
from cruise.limit.cascade import EULER, MEMORY, POSITION, STATE_SIZE, STEEPEST, VELOCITY, error_of_one, make_step
from cruise.limit.models import Range
from cruise.limit.transcription import SMOOTH, Condition, between, minimised, through, zeros

LARGEST_CHANGE = 2.0  # of an action from step to step: from one end of its range to the other
INSTANT = 1e-9  # [s]
SHORTEST, LONGEST = 0.3, 3.0  # steps while searching, times the vehicle's own


@dataclass(frozen=True)
class Steps:
    """K steps that pass S gates."""

    length: float  # of every step [s]
    crossed: np.ndarray  # [S] steps in which the gates are passed
    share: np.ndarray  # [S] of those steps that is flown before the gate, from 0 to 1
    state: np.ndarray  # [K + 1, 15]
    action: np.ndarray  # [K, 3]

    @property
    def moments(self) -> np.ndarray:
        """When the gates are passed [s], [S]."""
        return self.length * (self.crossed + self.share)


@dataclass(frozen=True)
class SteppedLap:
    """From gate to gate: the states at the ends of steps and, between them, where the lap begins and ends."""

    duration: np.ndarray  # [S] from gate to gate [s]
    clock: np.ndarray  # [T] times of the states [s]
    state: np.ndarray  # [T, 15]
    control: np.ndarray  # [T - 1, 3] held from one state to the next

    @property
    def time(self) -> float:
        """Of all of it [s]."""
        return float(self.duration.sum())


class _Unknowns(NamedTuple):
    length: ca.MX
    share: ca.MX  # [S]
    states: ca.MX  # [15, K + 1]
    actions: ca.MX  # [3, K]


def _unknowns(gates: int, steps: int) -> _Unknowns:
    return _Unknowns(
        ca.MX.sym("h"),
        ca.MX.sym("share", gates),
        ca.MX.sym("x", STATE_SIZE, steps + 1),
        ca.MX.sym("u", 3, steps),
    )


@dataclass(frozen=True)
class SteppedProblem:
    """Laps of a track: one in periodic flight, or some from standing in the middle of gate 0."""

    track: Track
    vehicle: Vehicle
    margin: float = 0.25  # kept from the edges of every opening, and from poles and walls [m]
    standing_laps: int = 0
    largest_change: float = LARGEST_CHANGE  # of an action, each of whose components lies in [-1, 1], between steps

    @property
    def gates(self) -> list[int]:
        """Those that are passed, in their order: in periodic flight gate 0 is the first, from standing the last."""
        count, first = len(self.track.gates), 1 if self.standing_laps else 0
        return [(first + s) % count for s in range(count * max(self.standing_laps, 1))]

    def time(self, steps: Steps) -> float:
        """Of the lap, or of all laps from standing [s]."""
        return float(steps.moments[-1]) if self.standing_laps else steps.length * len(steps.action)

    def lap(self, steps: Steps) -> SteppedLap:
        """The flight from gate 0 on: periodic flight passes it within a step, from standing it begins there."""
        start = 0.0 if self.standing_laps else float(steps.moments[0])
        gates = steps.moments if self.standing_laps else np.append(steps.moments[1:], start + self.time(steps))
        count = len(steps.action)
        state = np.concatenate([steps.state[:-1], steps.state])  # twice the lap; from standing the second is not used
        ends = np.arange(len(state)) * steps.length
        inner = ends[(ends > start + INSTANT) & (ends < gates[-1] - INSTANT)]
        clock = np.array([start, *inner, gates[-1]])
        held = (clock[:-1] / steps.length + INSTANT).astype(int) % count
        at_clock = between(clock, ends, state)
        return SteppedLap(np.diff(gates, prepend=start), clock - start, at_clock, steps.action[held])

    def solve(self, guess: Steps, exact: bool, rounding: float) -> Steps:
        """The fastest way near the guess in as many steps, the gates in the same ones.

        Args:
            guess: where to start.
            exact: steps have the vehicle's length; if not, they are all of one length that is free.
            rounding: see `make_step` [m/s^2].

        Raises:
            CruiseError: where the solver finds none.
        """
        count = len(guess.action)
        unknown = _unknowns(len(guess.crossed), count)
        conditions = [*self._motion(unknown, rounding), *self._gates(unknown, guess.crossed), *self._solids(unknown)]
        if not self.standing_laps:
            apart = unknown.states[:, -1] - unknown.states[:, 0]
            conditions.append((apart, zeros(apart)))
        end = guess.crossed[-1] + unknown.share[-1] if self.standing_laps else count
        change = unknown.actions[:, 1:] - unknown.actions[:, :-1]
        objective = unknown.length * end + SMOOTH * ca.sumsqr(change)
        start = np.concatenate([[guess.length], guess.share, guess.state.ravel(), guess.action.ravel()])
        bounds = self._bounds(len(guess.crossed), count, exact)
        try:
            found = minimised(objective, ca.veccat(*unknown), conditions, start, bounds)
        except CruiseError as error:
            raise CruiseError(f"no fastest lap of {self.track.name} by {self.vehicle.name} found: {error}") from error
        return _unpacked(found, guess)

    def _motion(self, unknown: _Unknowns, rounding: float) -> list[Condition]:
        count = unknown.actions.shape[1]
        step = make_step(self.vehicle, rounding).map(count)
        lengths = ca.repmat(unknown.length, 1, count)
        gap = step(unknown.states[:, :-1], unknown.actions, lengths) - unknown.states[:, 1:]
        change = unknown.actions - unknown.states[MEMORY, :-1] / error_of_one(self.vehicle)
        most = np.full(change.numel(), self.largest_change)
        return [(gap, zeros(gap)), (change, (-most, most))]

    def _gates(self, unknown: _Unknowns, crossed: np.ndarray) -> list[Condition]:
        conditions = []
        for s, (gate, k) in enumerate(zip(self.gates, crossed, strict=True)):
            before, after = unknown.states[POSITION, k], unknown.states[POSITION, k + 1]
            place = before + unknown.share[s] * (after - before)
            conditions.append(through(self.track.gates[gate], self.margin, place, unknown.states[VELOCITY, k]))
        return conditions

    def _solids(self, unknown: _Unknowns) -> list[Condition]:
        """The margin from poles and walls on the straight lines that the steps are."""
        line = keep_out.straight(unknown.states[POSITION, :-1], unknown.states[POSITION, 1:])
        return keep_out.beyond(self.track, self.margin, line)

    def _bounds(self, gates: int, count: int, exact: bool) -> Range:
        state_low, state_high = (np.full((count + 1, STATE_SIZE), sign * np.inf) for sign in (-1, 1))
        state_low[:, POSITION], state_high[:, POSITION] = self.track.bounds_low, self.track.bounds_high
        state_low[:, EULER], state_high[:, EULER] = -STEEPEST, STEEPEST
        if self.standing_laps:
            state_low[0] = state_high[0] = at_rest(self.track)
        dt = self.vehicle.control_dt
        shortest, longest = (dt, dt) if exact else (SHORTEST * dt, LONGEST * dt)
        ends = np.zeros(gates), np.ones(gates)
        actions = np.ones(3 * count)
        return (
            np.concatenate([[shortest], ends[0], state_low.ravel(), -actions]),
            np.concatenate([[longest], ends[1], state_high.ravel(), actions]),
        )


def at_rest(track: Track) -> np.ndarray:
    """Hovering in the middle of gate 0."""
    state = np.zeros(STATE_SIZE)
    state[POSITION] = track.gates[0].position_w
    return state


def _unpacked(numbers: np.ndarray, like: Steps) -> Steps:
    length, share, state, action = np.split(numbers, np.cumsum([1, like.share.size, like.state.size]))
    return replace(
        like,
        length=float(length[0]),
        share=np.clip(share, 0.0, 1.0),
        state=state.reshape(like.state.shape),
        action=action.reshape(like.action.shape),
    )
