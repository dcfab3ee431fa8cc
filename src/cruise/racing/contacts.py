"""What a drone can hit: other drones, the ground, solids, the limits of the track."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.geometry import NEVER, distance2_at, nearest_fraction
from cruise.racing.course import Course, over_columns
from cruise.racing.field import over_opponents
from cruise.racing.solids import KINDS, SolidKind


def meet_opponents(
    start_w: Float[Array, "3 N *B"],
    end_w: Float[Array, "3 N *B"],
    airborne: Bool[Array, "N *B"],
    distance: Array | float,
    until: Sequence[Float[Array, "N *B"]] = (),
    aspect: float = 1.0,
) -> tuple[Float[Array, "N *B"], list[Bool[Array, "N *B"]]]:
    """Closest approach to any other drone in the air within the step [m], infinite when alone.

    And for each of `until`, fractions of the step, whether another drone came nearer than `distance` [m] before; where
    that is an array over [N, *B], nearer than the mean of both drones' own. With
    another `aspect` than 1 heights count as if divided by it: the distance is that along the horizontal axes of an
    ellipsoid about the drone, `aspect` times as high as wide, on whose surface the other drone comes to lie.
    """
    if aspect != 1.0:
        start_w, end_w = (jnp.stack([x, y, z / aspect]) for x, y, z in (start_w, end_w))

    own = [(jnp.broadcast_to(distance, airborne.shape), 0)] if jnp.ndim(distance) else []

    def visit(
        found: tuple[Array, ...], k: Array | int, start1_w: Array, end1_w: Array, here: Array, *theirs: Array
    ) -> tuple[Array, ...]:
        apart = (distance + theirs[0]) / 2 if theirs else distance
        offset = start1_w - start_w
        motion = (end1_w - end_w) - offset
        both = airborne & here
        fraction = nearest_fraction(offset, motion)
        nearest, *touched = found
        nearest = jnp.minimum(nearest, jnp.where(both, distance2_at(offset, motion, fraction), jnp.inf))
        for i, last in enumerate(until):
            near = distance2_at(offset, motion, jnp.minimum(fraction, last)) < apart**2
            touched[i] = touched[i] | (both & near)
        return nearest, *touched

    nobody = jnp.full(airborne.shape, jnp.inf), *(jnp.zeros(airborne.shape, bool) for _ in until)
    nearest2, *touched = over_opponents(visit, nobody, (start_w, 1), (end_w, 1), (airborne, 0), *own)
    return jnp.sqrt(nearest2), touched


def on_ground(position_w: Float[Array, "3 *B"]) -> Bool[Array, "*B"]:
    """Touching the ground plane z = 0."""
    return position_w[2] <= 0.0


def out_of_bounds(course: Course, position_w: Float[Array, "3 *B"]) -> Bool[Array, "*B"]:
    """Outside the track's box, or farther than `leave_distance` from every gate, at the end of a step."""
    now = course if course.later is None else course.later
    return outside_box(course, position_w) | ~(course.leave_distance**2 >= nearest_gate_distance2(now, position_w))


def outside_box(course: Course, position_w: Float[Array, "3 *B"]) -> Bool[Array, "*B"]:
    """Outside the track's box, the ground apart. Who is outside at the end of a step leaves once within it."""
    inside = position_w[2] <= course.bounds_high[2]
    for axis in range(2):
        inside &= (position_w[axis] <= course.bounds_high[axis]) & (position_w[axis] >= course.bounds_low[axis])
    return ~inside


def meet_solids(
    course: Course, start_w: Float[Array, "3 *B"], end_w: Float[Array, "3 *B"]
) -> dict[str, Float[Array, "*B"]]:
    """By kind, the fraction of the step at which the first solid of that kind is met, or `NEVER`.

    Only of kinds that stand on the track.
    """
    tables = course.solids or {}
    return {kind.name: _meet_kind(kind, tables[kind.name], start_w, end_w) for kind in KINDS if kind.name in tables}


def _meet_kind(kind: SolidKind, table: Float[Array, "C S *B"], start_w: Array, end_w: Array) -> Array:
    def visit(first: Array, solid: Array | int) -> Array:
        return jnp.minimum(first, kind.contact(table[:, solid], start_w, end_w))

    return over_columns(table.shape[1], visit, jnp.full(end_w.shape[1:], NEVER))


def nearest_gate_distance2(course: Course, position_w: Float[Array, "3 *B"]) -> Float[Array, "*B"]:
    """Squared distance to the nearest gate's centre [m^2]."""

    def visit(nearest: Array, gate: Array | int) -> Array:
        x, y, z = (position_w[i] - course.position_w[i, gate] for i in range(3))
        return jnp.minimum(nearest, x * x + y * y + z * z)

    return over_columns(course.num_gates, visit, jnp.full(position_w.shape[1:], jnp.inf))
