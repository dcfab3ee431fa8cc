"""What a drone sees from its own seat: gates, motion and the nearest opponents in the frame of its body."""

import functools
import math
import operator

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.dynamics.types import Dynamics
from cruise.env.ranks import ranks
from cruise.env.types import RaceState
from cruise.racing.course import Course, pick
from cruise.racing.field import opponent, opponents
from cruise.vector import dot, norm, stored

CORNER_RANGE, SPEED_RANGE, HEIGHT_RANGE, OPPONENT_RANGE = 10.0, 10.0, 4.0, 5.0  # scales [m], [m/s]
NEAREST = 3  # opponents that are seen
NOTICE = {"body": math.inf, "body-near": 6.0}  # by kind: farther away nobody is seen, within half of it all of him [m]
GATES_AHEAD = 2
LIMIT = 3.0  # clipped to [-LIMIT, LIMIT]
ABSENT = 1e6  # sorts an opponent that left the air behind all others [m]
OPPONENT_SIZE = 7


def body_observation(
    course: Course, dynamics: Dynamics, state: RaceState, notice: float = math.inf
) -> Float[Array, "O N *B"]:
    """The corners of the next two gates, own motion, what the vehicle feels of itself, and the nearest opponents.

    Everything is along the body's axes (forward, left, up), so that it looks the same wherever the drone flies and
    whichever way it faces. Of opponents the three nearest are seen, nearest first, each as relative position, relative
    velocity and a 1; zeros where there are fewer. So the size, 52 + K with K numbers of `Dynamics.internal`, depends
    neither on the number of drones nor on their order, and one policy can race in fields of any size. Clipped to
    [-3, 3].

    With `notice` [m], opponents fade out with distance and are gone there: who leads by as much flies as if alone.
    """
    position, velocity = state.drones.position_w, state.drones.velocity_w
    turn = stored(dynamics.rotation(state.drones))
    parts = [
        corner
        for ahead in range(GATES_AHEAD)
        for corner in _corners(course, (state.next_gate + ahead) % course.num_gates, position, turn)
    ]
    parts += [
        to_body(turn, velocity) / SPEED_RANGE,
        turn[2],  # up
        dynamics.internal(state.drones),
        position[2:] / HEIGHT_RANGE,
        *_nearest_first(turn, state, notice),
    ]
    return jnp.clip(jnp.concatenate(parts), -LIMIT, LIMIT)


def to_body(turn: Float[Array, "3 3 *B"], vector_w: Float[Array, "3 *B"]) -> Float[Array, "3 *B"]:
    """R^T v: a world vector along the body's axes."""
    return jnp.stack([dot(turn[:, axis], vector_w) for axis in range(3)])


def _corners(
    course: Course, gate: Int[Array, "N *B"], position_w: Float[Array, "3 N *B"], turn: Float[Array, "3 3 N *B"]
) -> list[Float[Array, "3 N *B"]]:
    """From the drone to the corners of a gate's opening: upper left, lower left, lower right, upper right."""
    centre_w, (cos_yaw, sin_yaw), half = (
        pick(table, gate) for table in (course.position_w, course.normal_w, course.half_size)
    )
    centre = stored(to_body(turn, centre_w - position_w))
    left = stored(to_body(turn, jnp.stack([-sin_yaw * half[0], cos_yaw * half[0], jnp.zeros_like(sin_yaw)])))
    up = turn[2] * half[1]
    ways = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return [(centre + sideways * left + upwards * up) / CORNER_RANGE for sideways, upwards in ways]


def _nearest_first(turn: Float[Array, "3 3 N *B"], state: RaceState, notice: float) -> list[Float[Array, "7 N *B"]]:
    """Seven numbers for each of the nearest opponents in the air; zeros where there is none."""
    position, velocity, airborne = state.drones.position_w, state.drones.velocity_w, state.airborne
    seen, separations = [], []
    for k in opponents(airborne.shape[0]):
        here = opponent(airborne, k, 0)
        offset, motion = opponent(position, k, 1) - position, opponent(velocity, k, 1) - velocity
        seen.append((offset, motion, here))
        separations.append(jnp.where(here, norm(offset), ABSENT))
    places = [stored(place.astype(jnp.float32)) for place in ranks(separations)]
    slots = []
    for slot in range(min(NEAREST, len(seen))):
        chosen = [here & (place == slot) for (_, _, here), place in zip(seen, places, strict=True)]
        offset, motion = (
            functools.reduce(
                operator.add, [jnp.where(flag, one[i], 0.0) for flag, one in zip(chosen, seen, strict=True)]
            )
            for i in range(2)
        )
        present = functools.reduce(operator.or_, chosen)[None].astype(jnp.float32)
        numbers = jnp.concatenate(
            [to_body(turn, offset) / OPPONENT_RANGE, to_body(turn, motion) / SPEED_RANGE, present]
        )
        slots.append(numbers if math.isinf(notice) else noticed(norm(offset), notice) * numbers)
    nobody = jnp.zeros((OPPONENT_SIZE, *airborne.shape))
    return slots + [nobody] * (NEAREST - len(slots))


def noticed(separation: Float[Array, "*B"], notice: float) -> Float[Array, "*B"]:
    """How much of an opponent so far away is seen: all within half of `notice`, nothing beyond it [m]."""
    return jnp.clip(2.0 - 2.0 * separation / notice, 0.0, 1.0)
