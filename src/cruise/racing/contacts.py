"""What a drone can hit: other drones, the ground, the limits of the track."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.racing.course import Course
from cruise.racing.field import opponent, opponents
from cruise.vector import dot, norm


def closest_approach(
    start0_w: Float[Array, "3 *B"], end0_w: Float[Array, "3 *B"], start1_w: Array, end1_w: Array
) -> Float[Array, "*B"]:
    """Smallest distance [m] of two drones while each flies its segment at constant velocity."""
    start = start1_w - start0_w
    motion = (end1_w - end0_w) - start
    fraction = jnp.clip(-dot(start, motion) / jnp.maximum(dot(motion, motion), 1e-12), 0.0, 1.0)
    return norm(start + fraction * motion)


def nearest_opponent(
    start_w: Float[Array, "3 N *B"], end_w: Float[Array, "3 N *B"], airborne: Bool[Array, "N *B"], aspect: float = 1.0
) -> Float[Array, "N *B"]:
    """Closest approach to any other drone in the air within the step [m]; infinite when alone.

    With another `aspect` than 1 heights count as if divided by it: the distance is that along the horizontal axes of an
    ellipsoid about the drone, `aspect` times as high as wide, on whose surface the other drone comes to lie.
    """
    if aspect != 1.0:
        start_w, end_w = (jnp.stack([x, y, z / aspect]) for x, y, z in (start_w, end_w))
    nearest = jnp.full(airborne.shape, jnp.inf)
    for k in opponents(airborne.shape[0]):
        distance = closest_approach(start_w, end_w, opponent(start_w, k, 1), opponent(end_w, k, 1))
        both = airborne & opponent(airborne, k, 0)
        nearest = jnp.minimum(nearest, jnp.where(both, distance, jnp.inf))
    return nearest


def on_ground(position_w: Float[Array, "3 *B"]) -> Bool[Array, "*B"]:
    """Touching the ground plane z = 0."""
    return position_w[2] <= 0.0


def out_of_bounds(course: Course, position_w: Float[Array, "3 *B"]) -> Bool[Array, "*B"]:
    """Outside the track's box (the ground apart), or farther than `leave_distance` from every gate."""
    inside = course.leave_distance**2 >= nearest_gate_distance2(course, position_w)
    for axis in range(3):
        inside &= position_w[axis] <= course.bounds_high[axis]
    for axis in range(2):
        inside &= position_w[axis] >= course.bounds_low[axis]
    return ~inside


def nearest_gate_distance2(course: Course, position_w: Float[Array, "3 *B"]) -> Float[Array, "*B"]:
    """Squared distance to the nearest gate's centre [m^2]."""
    nearest = jnp.full(position_w.shape[1:], jnp.inf)
    for gate in range(course.num_gates):
        x, y, z = (position_w[i] - course.position_w[i, gate] for i in range(3))
        nearest = jnp.minimum(nearest, x * x + y * y + z * z)
    return nearest
