"""Which steps the gates of a lap lie in, and how many steps it takes: found by solving, shifting and shaking.

From a smooth line flown with gentle commands, to which the solver has only one answer, on to free ones. Those have
many: a command that jumps to and fro pushes harder than one that is held. What is found is the best of several tries,
each from the best so far with its actions shaken.
"""

from dataclasses import replace

import numpy as np

from cruise.errors import CruiseError
from cruise.limit import guess
from cruise.limit.cascade import POSITION, STATE_SIZE, VELOCITY
from cruise.limit.stepped import SteppedProblem, Steps, at_rest
from cruise.limit.transcription import between, first_found

GENTLE = 0.2  # change of an action from step to step
SPEEDS = (3.0, 1.5, 5.0)  # of the line that the search starts with, tried in turn [m/s]
ROUND, SHARPER = 0.3, (0.05, 0.02)  # corner of the thrust while searching, and in the end [m/s^2]
PATIENCE = 5  # solutions in a row that are no faster
SLOWER = (1.0, 1.01, 1.02, 1.05, 1.1)  # until it can be flown in steps of the vehicle's length
TRIES, LARGEST_SHAKE = 80, 0.4
GRANTED, AT_RANDOM = 0.7, (0.1, 0.8, 0.1)  # shares of the gates whose wish is granted, and that are shifted regardless
ENOUGH = 1e-4  # gain that counts [s]
EDGE, SLACK = 1e-4, 1e-3  # shares of a step


def fastest(problem: SteppedProblem) -> Steps:
    """The best lap found. Raises CruiseError where there is none.

    Periodic flight repeats itself after a whole number of steps, so that their length only comes close to the
    vehicle's. From standing it is the vehicle's own, once a first lap is found with one that is free.
    """
    gentle = replace(problem, largest_change=min(GENTLE, problem.largest_change))
    steps = _from_scratch(gentle)
    if problem.largest_change > GENTLE:
        steps = _shaken(problem, _settled(problem, steps))
    if problem.standing_laps:
        steps = _exact(problem, steps)
    for rounding in SHARPER:
        steps = _settled(problem, steps, rounding, exact=problem.standing_laps > 0)
    return steps


def _from_scratch(problem: SteppedProblem) -> Steps:
    """The first of several smooth lines that leads to a lap."""
    return first_found(lambda speed: _settled(problem, first_line(problem, speed)), SPEEDS)


def first_line(problem: SteppedProblem, speed: float) -> Steps:
    """A smooth line through the gates, cut into steps of the vehicle's length."""
    dt, laps = problem.vehicle.control_dt, problem.standing_laps or 1
    duration, spline = guess.spline(problem.track, speed, laps)
    arrivals = np.concatenate([[0.0], np.cumsum(duration)])
    lead = 0.0 if problem.standing_laps else dt / 2  # gate 0 lies within the first step
    moments = arrivals[1:] if problem.standing_laps else arrivals[:-1] + lead
    count = int(np.ceil(arrivals[-1] / dt)) + (1 if problem.standing_laps else 0)
    clock = np.arange(count + 1) * dt - lead
    state = np.zeros((count + 1, STATE_SIZE))
    state[:, POSITION], state[:, VELOCITY] = spline(clock), spline(clock, 1)
    if problem.standing_laps:
        state[0] = at_rest(problem.track)
    crossed = np.minimum((moments / dt).astype(int), count - 1)
    return Steps(dt, crossed, np.clip(moments / dt - crossed, 0, 1), state, np.zeros((count, 3)))


def _settled(problem: SteppedProblem, steps: Steps, rounding: float = ROUND, exact: bool = False) -> Steps:
    """Solved, with the gates shifted to the steps that they want to lie in and, unless exact, as many steps as fit."""
    best = found = problem.solve(steps, exact, rounding)
    moves, in_vain, seen = np.zeros_like(steps.crossed), 0, set[tuple[int, ...]]()
    while in_vain < PATIENCE:
        wish = _wish(found)
        moves = np.where(wish * moves > 0, 2 * moves, wish)  # ever further in the same direction
        steps = _shifted(found, moves) if exact else _recut(problem, _shifted(found, moves))
        key = (len(steps.action), *steps.crossed)
        if steps is found or key in seen:
            break
        seen.add(key)
        try:
            found = problem.solve(steps, exact, rounding)
        except CruiseError:
            break
        in_vain = 0 if problem.time(found) < problem.time(best) - ENOUGH else in_vain + 1
        best = found if in_vain == 0 else best
    return best


def _wish(steps: Steps) -> np.ndarray:
    """1 for a gate that would rather lie in a later step than its own, -1 in an earlier one, 0 for others."""
    return np.where(steps.share > 1 - EDGE, 1, np.where(steps.share < EDGE, -1, 0))


def _shifted(steps: Steps, moves: np.ndarray) -> Steps:
    """Gates in other steps, in the same order."""
    crossed = np.clip(np.maximum.accumulate(steps.crossed + moves), 0, len(steps.action) - 1)
    moved = crossed - steps.crossed
    if not moved.any():
        return steps
    return replace(steps, crossed=crossed, share=np.where(moved > 0, 0.0, np.where(moved < 0, 1.0, steps.share)))


def _exact(problem: SteppedProblem, steps: Steps) -> Steps:
    """In steps of the vehicle's length: the same flight or, where that cannot be, one that takes a little longer."""

    def settled(slower: float) -> Steps:
        return _settled(problem, _recut(problem, replace(steps, length=slower * steps.length)), exact=True)

    return first_found(settled, SLOWER)


def _recut(problem: SteppedProblem, steps: Steps) -> Steps:
    """The same flight in as many steps as just fit the vehicle's length; from standing, with one to spare."""
    end = min(steps.crossed[-1] + 2, len(steps.action)) if problem.standing_laps else len(steps.action)
    wanted = max(int(np.ceil(end * steps.length / problem.vehicle.control_dt - SLACK)), len(steps.crossed))
    if wanted == len(steps.action):
        return steps
    old, new = np.arange(len(steps.state)), np.linspace(0, end, wanted + 1)
    place = (steps.crossed + steps.share) * wanted / end
    crossed = np.minimum(place.astype(int), wanted - 1)
    return replace(
        steps,
        length=steps.length * end / wanted,
        crossed=crossed,
        share=place - crossed,
        state=between(new, old, steps.state),
        action=between(new[:-1], old[:-1], steps.action),
    )


def _shaken(problem: SteppedProblem, best: Steps) -> Steps:
    """The best of several tries from the best so far, its actions shaken and some of its gates shifted."""
    rng = np.random.default_rng(0)
    for size in LARGEST_SHAKE * rng.uniform(size=TRIES):
        wish = np.where(rng.uniform(size=len(best.crossed)) < GRANTED, _wish(best), 0)
        shaken = _shifted(best, wish + rng.choice((-1, 0, 1), size=wish.size, p=AT_RANDOM))
        action = np.clip(shaken.action + size * rng.normal(size=shaken.action.shape), -1, 1)
        try:
            found = problem.solve(replace(shaken, action=action), exact=False, rounding=ROUND)
            if problem.time(found) < problem.time(best) - ENOUGH:
                best, cut = found, _recut(problem, found)
                best = found if cut is found else problem.solve(cut, exact=False, rounding=ROUND)
        except CruiseError:
            continue
    return best
