"""Where the gates of each race stand now: moved by what was drawn for it, and by themselves. Still gates cost nothing.

A race keeps where its gates stand, so that whoever looks at it sees them there; time is its step.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from cruise.env.sensing import Gates
from cruise.env.surroundings import MovedGates, Surroundings
from cruise.env.types import RaceState
from cruise.racing.course import Course, course_at

Step = Array | np.ndarray  # of each race [*B]


def course_now(course: Course, surroundings: Surroundings) -> Course:
    """The course of each race."""
    moved = surroundings.gates
    if moved is None:
        return course
    return course._replace(**{name: table for name, table in moved._asdict().items() if table is not None})


def course_of_start(course: Course, dt: float, surroundings: Surroundings, races: tuple[int, ...]) -> Course:
    """The course of races that begin, of what was drawn for them."""
    return course_now(course, _moved_on(course, dt, surroundings, np.zeros(races, np.int32)))


def with_gates_at(course: Course, dt: float, state: RaceState) -> RaceState:
    """Races with their gates where they stand at their step."""
    return state._replace(surroundings=_moved_on(course, dt, state.surroundings, state.step))


def over_step(course: Course, dt: float, state: RaceState) -> tuple[Course, Surroundings]:
    """The course as it is, where gates move with what it is like after a step; the surroundings after that step."""
    here = course_now(course, state.surroundings)
    if course.motions is None:
        return here, state.surroundings
    surroundings = _moved_on(course, dt, state.surroundings, state.step + 1)
    return here._replace(later=course_now(course, surroundings)), surroundings


def gates_and_told(course: Course, dt: float, state: RaceState) -> tuple[Gates, Gates]:
    """The gates as they stand, and as they stood when the look was taken that arrives now. Sensing is not exact."""
    here, surroundings = course_now(course, state.surroundings), state.surroundings
    gates = Gates(here.position_w, here.normal_w, here.solids)
    if surroundings.rest is None or surroundings.sensed is None:
        return gates, gates
    then = _at_step(course, dt, surroundings.rest, state.step - surroundings.sensed.sensor.latency)
    return gates, gates._replace(position_w=then.position_w, normal_w=then.normal_w)


def _moved_on(course: Course, dt: float, surroundings: Surroundings, step: Step) -> Surroundings:
    if course.motions is None:
        return surroundings
    moved, rest = surroundings.gates or MovedGates(course.position_w, course.normal_w), surroundings.rest
    if rest is None:
        rest = Gates(_of_races(moved.position_w, step.shape), _of_races(moved.normal_w, step.shape))
    now = _at_step(course, dt, rest, step)
    return surroundings._replace(rest=rest, gates=moved._replace(position_w=now.position_w, normal_w=now.normal_w))


def _at_step(course: Course, dt: float, rest: Gates, step: Step) -> Course:
    return course_at(course._replace(position_w=rest.position_w, normal_w=rest.normal_w), jnp.asarray(step) * dt)


def _of_races(table: Array, races: tuple[int, ...]) -> Array:
    """[C, G] as [C, G, *B]; those that have axes of races as they are."""
    if table.ndim > 2:
        return table
    return jnp.broadcast_to(table.reshape(*table.shape, *(1,) * len(races)), (*table.shape, *races))
