"""Where drones wait for the start: side by side before a gate, never closer than 1 m."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.racing.course import Course, pick

LANES = 4  # drones in a row
LANE_SPACING = 1.25  # [m]
ROW_SPACING = 1.5  # [m]
JITTER = 0.08  # of every coordinate; even along a diagonal 1.25 - 2 * 0.08 * sqrt(2) > 1.02 m remain between two [m]
NEAREST, FARTHEST = 1.5, 3.0  # of the first row from the gate [m]
MIN_HEIGHT = 0.3  # [m]


class Start(NamedTuple):
    """A grid of drones at rest."""

    position_w: Float[Array, "3 N *B"]  # [m]
    heading: Float[Array, "N *B"]  # [rad]
    gate: Int[Array, "*B"]  # the first gate to pass


def start_grid(
    course: Course, key: Array, num_drones: int, batch: tuple[int, ...] = (), gate: int | None = None
) -> Start:
    """Random starts: a random gate (or `gate`), lanes drawn anew, everything jittered."""
    gate_key, back_key, lane_key, jitter_key = jax.random.split(key, 4)
    if gate is None:
        gates = jax.random.randint(gate_key, batch, 0, course.num_gates)
    else:
        gates = jnp.full(batch, gate)
    slot = jnp.argsort(jax.random.uniform(lane_key, (num_drones, *batch)), axis=0)
    row, lane = slot // LANES, slot % LANES
    in_row = jnp.minimum(num_drones - row * LANES, LANES)
    sideways = (lane - (in_row - 1) / 2) * LANE_SPACING
    back = jax.random.uniform(back_key, batch, minval=NEAREST, maxval=FARTHEST) + row * ROW_SPACING
    centre, normal = pick(course.position_w, gates), pick(course.normal_w, gates)
    x = centre[0] - normal[0] * back - normal[1] * sideways
    y = centre[1] - normal[1] * back + normal[0] * sideways
    z = jnp.broadcast_to(centre[2], x.shape)
    jitter = jax.random.uniform(jitter_key, (3, num_drones, *batch), minval=-JITTER, maxval=JITTER)
    position = jnp.stack([x, y, z]) + jitter
    position = position.at[2].max(MIN_HEIGHT)
    heading = jnp.broadcast_to(jnp.arctan2(normal[1], normal[0]), x.shape)
    return Start(position, heading, gates)
