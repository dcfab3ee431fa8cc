"""Swept gate crossing: where the segment flown in a step meets the planes of the gates."""

import functools
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from cruise.geometry import NEVER, beyond_opening, from_gate, plane_fraction, to_gate
from cruise.racing.course import Course, Opening, opening, over_columns, target_opening
from cruise.vector import once, stored

NEAR_GATE = 5.0  # crossing the target's plane within this distance of its opening is a miss, farther is a detour [m]


class Crossing(NamedTuple):
    """What a step did at the target gate, whose plane it crosses at most once, and at the frames of all."""

    passed: Bool[Array, "*B"]  # the target gate, in the right direction, inside its opening
    missed: Bool[Array, "*B"]  # flew by the target gate beside its opening and frame
    hit_frame: Bool[Array, "*B"]  # struck the solid border of any gate
    fraction: Float[Array, "*B"]  # of the step at which the target's plane was crossed, in [0, 1]
    offset: Float[Array, "*B"]  # how far beyond the nominal opening's edge it was crossed, negative inside [m]
    frame_fraction: Float[Array, "*B"] | float = NEVER  # of the step at which the first frame was struck


class PlaneCrossing(NamedTuple):
    """Where a segment meets the plane of one gate."""

    ahead: Bool[Array, "*B"]  # in the direction of flight
    back: Bool[Array, "*B"]
    fraction: Float[Array, "*B"]
    offset: Float[Array, "*B"]  # beyond the edge of the opening, negative inside [m]


def gate_coordinates(gate: Opening, position_w: Float[Array, "3 *B"]) -> tuple[Array, Array, Array]:
    """Position in the frame of a gate [m]: forward along its normal, to the left, up."""
    x, y, z = (position_w[i] - gate.position_w[i] for i in range(3))
    return to_gate(gate.normal_w, (x, y, z), gate.tilt)


def cross_plane(course: Course, gate: int, start_w: Float[Array, "3 *B"], end_w: Float[Array, "3 *B"]) -> PlaneCrossing:
    """Intersection of the segment with the plane of one gate of a course."""
    return cross_opening(opening(course, gate), start_w, end_w)


def cross_opening(gate: Opening, start_w: Float[Array, "3 *B"], end_w: Float[Array, "3 *B"]) -> PlaneCrossing:
    """Intersection of the segment with the plane of a gate.

    In the frame of the gate: where it moves within the step, each end as it is seen from where the gate is then.
    """
    forward0, left0, up0 = gate_coordinates(gate, start_w)
    forward1, left1, up1 = gate_coordinates(gate if gate.later is None else gate.later, end_w)
    fraction = plane_fraction(forward0, forward1)
    left = left0 + fraction * (left1 - left0)
    up = up0 + fraction * (up1 - up0)
    is_round = None if gate.is_round is None else gate.is_round[0]
    return PlaneCrossing(
        ahead=(forward0 < 0) & (forward1 >= 0),
        back=(forward0 >= 0) & (forward1 < 0),
        fraction=fraction,
        offset=beyond_opening(left, up, gate.half_size[0], gate.half_size[1], is_round),
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

    def visit(found: tuple[Array, ...], gate: int | Int[Array, ""]) -> tuple[Array, ...]:
        ahead, fraction, offset, frame_fraction = found
        here = opening(course, gate)
        plane = cross_opening(here, start_w, end_w)
        is_target = target == gate
        faces = [plane, *(cross_opening(face, start_w, end_w) for face in _faces(here, course.half_depth))]
        return (
            ahead | (plane.ahead & is_target),
            jnp.where(is_target, plane.fraction, fraction),
            jnp.where(is_target, plane.offset, offset),
            functools.reduce(
                jnp.minimum, (_struck(face, course.frame_width, tolerance) for face in faces), frame_fraction
            ),
        )

    zero = jnp.zeros(target.shape)
    ahead, *numbers = over_columns(course.num_gates, visit, (zero > 0, zero, zero, zero + NEVER))
    # each is the end of a long chain over all gates, and much is asked of it
    ahead, (fraction, offset, frame_fraction) = once(ahead), map(stored, numbers)
    return Crossing(
        passed=ahead & (offset <= tolerance),
        missed=ahead & _beside(offset, course, tolerance),
        hit_frame=frame_fraction < NEVER,
        fraction=fraction,
        offset=offset,
        frame_fraction=frame_fraction,
    )


def _faces(gate: Opening, half_depth: Array | None) -> list[Opening]:
    """Where the frame begins and ends along the flight, where it has a depth: the gate, so far before and behind."""
    if half_depth is None:
        return []
    ahead = from_gate(gate.normal_w, (half_depth, 0.0, 0.0), gate.tilt)
    later = [None, None] if gate.later is None else _faces(gate.later, half_depth)
    return [
        gate._replace(
            position_w=jnp.stack([at + side * by for at, by in zip(gate.position_w, ahead, strict=True)]), later=face
        )
        for side, face in zip((-1, 1), later, strict=True)
    ]


def _struck(plane: PlaneCrossing, frame_width: Array, tolerance: Array | float) -> Array:
    """The fraction of the step at which the frame is struck in a plane, or `NEVER`."""
    on_frame = (plane.offset > tolerance) & (plane.offset <= tolerance + frame_width)
    return jnp.where(on_frame & (plane.ahead | plane.back), plane.fraction, NEVER)


def cross_next(
    course: Course,
    start_w: Float[Array, "3 *B"],
    end_w: Float[Array, "3 *B"],
    before: Crossing,
    target: Int[Array, "*B"],
    tolerance: Array | float,
) -> Crossing:
    """What the rest of a step did at `target`, the gate after the one that was passed `before` in the same step.

    Where none was passed nothing is. Frames are those of `before`, which knows them all.
    """
    plane = cross_opening(target_opening(course, target), start_w, end_w)
    ahead = before.passed & plane.ahead & (plane.fraction > before.fraction)
    return before._replace(
        passed=ahead & (plane.offset <= tolerance),
        missed=ahead & _beside(plane.offset, course, tolerance),
        fraction=plane.fraction,
        offset=plane.offset,
    )


def _beside(offset: Float[Array, "*B"], course: Course, tolerance: Array | float) -> Bool[Array, "*B"]:
    """Beyond the frame, yet no detour."""
    return (offset > tolerance + course.frame_width) & (offset <= NEAR_GATE)


def follow_gates(
    course: Course,
    start_w: Float[Array, "3 *B"],
    end_w: Float[Array, "3 *B"],
    target: Int[Array, "*B"],
    tolerance: Array | float,
    passes: int = 1,
) -> list[Crossing]:
    """Crossings of the segment at the target gate and at up to `passes` - 1 after it, each beyond the one before."""
    crossings = [cross_gates(course, start_w, end_w, target, tolerance)]
    for ahead in range(1, passes):
        gate = (target + ahead) % course.num_gates
        crossings.append(cross_next(course, start_w, end_w, crossings[-1], gate, tolerance))
    return crossings
