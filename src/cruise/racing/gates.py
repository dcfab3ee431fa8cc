"""Swept gate crossing: where the segment flown in a step meets the planes of the gates."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from cruise.racing.course import Course

NEAR_GATE = 5.0  # crossing the target's plane within this distance of its opening is a miss, farther is a detour [m]


class Crossing(NamedTuple):
    """What a step did at the gates; a step crosses the target gate at most once."""

    passed: Bool[Array, "*B"]  # the target gate, in the right direction, inside its opening
    missed: Bool[Array, "*B"]  # flew by the target gate beside its opening and frame
    hit_frame: Bool[Array, "*B"]  # struck the solid border of any gate
    fraction: Float[Array, "*B"]  # of the step at which the target's plane was crossed, in [0, 1]
    offset: Float[Array, "*B"]  # how far beyond the nominal opening's edge it was crossed, negative inside [m]


class PlaneCrossing(NamedTuple):
    """Where a segment meets the plane of one gate."""

    ahead: Bool[Array, "*B"]  # in the direction of flight
    back: Bool[Array, "*B"]
    fraction: Float[Array, "*B"]
    offset: Float[Array, "*B"]  # beyond the edge of the opening, negative inside [m]


def gate_coordinates(course: Course, gate: int, position_w: Float[Array, "3 *B"]) -> tuple[Array, Array, Array]:
    """Position in the frame of one gate [m]: forward along its normal, to the left, up."""
    x, y, z = (position_w[i] - course.position_w[i, gate] for i in range(3))
    cos_yaw, sin_yaw = course.normal_w[0, gate], course.normal_w[1, gate]
    return cos_yaw * x + sin_yaw * y, cos_yaw * y - sin_yaw * x, z


def cross_plane(course: Course, gate: int, start_w: Float[Array, "3 *B"], end_w: Float[Array, "3 *B"]) -> PlaneCrossing:
    """Intersection of the segment with the plane of one gate."""
    forward0, left0, up0 = gate_coordinates(course, gate, start_w)
    forward1, left1, up1 = gate_coordinates(course, gate, end_w)
    length = forward1 - forward0
    fraction = jnp.clip(-forward0 / jnp.where(length == 0, 1.0, length), 0.0, 1.0)
    left = left0 + fraction * (left1 - left0)
    up = up0 + fraction * (up1 - up0)
    half_width, half_height = course.half_size[0, gate], course.half_size[1, gate]
    return PlaneCrossing(
        ahead=(forward0 < 0) & (forward1 >= 0),
        back=(forward0 >= 0) & (forward1 < 0),
        fraction=fraction,
        offset=jnp.maximum(jnp.abs(left) - half_width, jnp.abs(up) - half_height),
    )


def cross_gates(
    course: Course,
    start_w: Float[Array, "3 *B"],
    end_w: Float[Array, "3 *B"],
    target: Int[Array, "*B"],
    tolerance: Array | float,
) -> Crossing:
    """Crossings of the segment from `start_w` to `end_w`.

    `tolerance` [m] widens every opening: crossings inside it count, and the frame begins behind it.
    """
    no, zero = jnp.zeros(target.shape, bool), jnp.zeros(target.shape)
    result = Crossing(no, no, no, zero, zero)
    for gate in range(course.num_gates):
        plane = cross_plane(course, gate, start_w, end_w)
        is_target = target == gate
        inside = plane.offset <= tolerance
        on_frame = ~inside & (plane.offset <= tolerance + course.frame_width)
        beside = ~inside & ~on_frame & (plane.offset <= NEAR_GATE)
        result = Crossing(
            passed=result.passed | (plane.ahead & inside & is_target),
            missed=result.missed | (plane.ahead & beside & is_target),
            hit_frame=result.hit_frame | ((plane.ahead | plane.back) & on_frame),
            fraction=jnp.where(is_target, plane.fraction, result.fraction),
            offset=jnp.where(is_target, plane.offset, result.offset),
        )
    return result
