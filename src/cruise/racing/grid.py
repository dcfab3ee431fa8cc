"""Where drones wait for the start: side by side before a gate, or at the places that the track says."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.racing.course import Course, pick
from cruise.racing.start_room import (
    JITTER,
    LANE_SPACING,
    MIN_HEIGHT,
    NEAREST,
    ROW_SPACING,
    USUAL,
    StartPlan,
)


class Start(NamedTuple):
    """A grid of drones at rest."""

    position_w: Float[Array, "3 N *B"]  # [m]
    heading: Float[Array, "N *B"]  # [rad]
    gate: Int[Array, "..."]  # the first gate to pass, [*B] or of every drone [N *B]


def start_grid(
    course: Course,
    key: Array,
    num_drones: int,
    batch: tuple[int, ...] = (),
    gate: int | None = None,
    plan: StartPlan | None = None,
) -> Start:
    """Random starts: a random gate (or `gate`), lanes drawn anew, everything jittered.

    A `plan` says where there is room, or which places to draw; the usual grid fits everywhere without one.
    """
    gate_key, back_key, lane_key, jitter_key = jax.random.split(key, 4)
    jitter = jax.random.uniform(jitter_key, (3, num_drones, *batch), minval=-JITTER, maxval=JITTER)
    slot = jnp.argsort(jax.random.uniform(lane_key, (num_drones, *batch)), axis=0)
    if plan is not None and plan.places and gate is None:
        return _at_places(plan, slot, jitter)
    gates = _first_gates(course, gate_key, batch, gate, plan)
    lanes, scale, farthest = _grid_of(gates, plan)
    row, lane = slot // lanes, slot % lanes
    in_row = jnp.minimum(num_drones - row * lanes, lanes)
    sideways = (lane - (in_row - 1) / 2) * (LANE_SPACING * scale)
    back = jax.random.uniform(back_key, batch, minval=NEAREST, maxval=farthest) + row * (ROW_SPACING * scale)
    return before_gates(course, gates, back, sideways, jitter)


def spread_start(
    course: Course, key: Array, num_drones: int, batch: tuple[int, ...] = (), plan: StartPlan | None = None
) -> Start:
    """Random starts all along the track: every drone in the middle before a gate of its own.

    Where there are more drones than gates with room, by the `plan` of as many rows of one, they wait behind each other.
    """
    gate_key, back_key, jitter_key = jax.random.split(key, 3)
    jitter = jax.random.uniform(jitter_key, (3, num_drones, *batch), minval=-JITTER, maxval=JITTER)
    with_room = jnp.arange(course.num_gates) if plan is None else jnp.array(plan.gates)
    shuffled = with_room[jnp.argsort(jax.random.uniform(gate_key, (len(with_room), *batch)), axis=0)]
    row, place = jnp.divmod(jnp.arange(num_drones), len(with_room))
    gates = shuffled[place]
    _, scale, farthest = _grid_of(gates, plan)
    first = jax.random.uniform(back_key, gates.shape, minval=NEAREST, maxval=farthest)[place]  # of its file
    back = first + row.reshape(-1, *(1,) * len(batch)) * (ROW_SPACING * scale)
    return before_gates(course, gates, back, jnp.zeros_like(back), jitter)


def before_gates(
    course: Course,
    gates: Int[Array, "..."],
    back: Float[Array, "N *B"],
    sideways: Float[Array, "N *B"],
    jitter: Float[Array, "3 N *B"] | float = 0.0,
) -> Start:
    """Drones at rest so far before gates and so far to the left of their middle [m], facing them, off the ground.

    One gate for all drones of a race, [*B], or for every drone its own, [N *B].
    """
    centre, normal = pick(course.position_w, gates), pick(course.normal_w, gates)
    x = centre[0] - normal[0] * back - normal[1] * sideways
    y = centre[1] - normal[1] * back + normal[0] * sideways
    z = jnp.broadcast_to(centre[2], x.shape)
    position = jnp.stack([x, y, z]) + jitter
    position = position.at[2].max(MIN_HEIGHT)
    heading = jnp.broadcast_to(jnp.arctan2(normal[1], normal[0]), x.shape)
    return Start(position, heading, gates)


def _first_gates(
    course: Course, key: Array, batch: tuple[int, ...], gate: int | None, plan: StartPlan | None
) -> Int[Array, "*B"]:
    if gate is not None:
        return jnp.full(batch, gate)
    if plan is None or len(plan.gates) == course.num_gates:
        return jax.random.randint(key, batch, 0, course.num_gates)
    return jnp.array(plan.gates)[jax.random.randint(key, batch, 0, len(plan.gates))]


def _grid_of(gates: Int[Array, "*B"], plan: StartPlan | None) -> tuple[Array | float, ...]:
    """Lanes, scale and farthest first row of the grid before each first gate."""
    if plan is None:
        return USUAL
    return tuple(jnp.array(column)[gates] for column in zip(*plan.grids, strict=True))


def _at_places(plan: StartPlan, slot: Int[Array, "N *B"], jitter: Float[Array, "3 N *B"]) -> Start:
    """The first places, as many as there are drones, dealt out by chance."""
    position = jnp.array([place for place, _ in plan.places]).T[:, slot]
    lowest = jnp.minimum(position[2], MIN_HEIGHT)
    heading = jnp.array([yaw for _, yaw in plan.places])[slot]
    gate = jnp.full(slot.shape[1:], plan.gates[0])
    return Start((position + jitter).at[2].max(lowest), heading, gate)
