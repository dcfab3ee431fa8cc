"""The paper's reward (Sec. 3.2.2) and the project's additions: one function per equation, terms that weigh them."""

import functools

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import RewardWeights
from cruise.env.step_view import StepView
from cruise.env.view import LAST
from cruise.racing.field import over_opponents
from cruise.racing.gates import cross_opening
from cruise.terms import RewardTerm
from cruise.vector import dot, norm

EPSILON = 1e-6


def proximity(distance: Float[Array, "*B"], decay: float, reach: float) -> Float[Array, "*B"]:
    """R_prox = 2 (exp(-a x) - exp(-a)) / (1 - exp(-a)) - 1, with x = distance / reach."""
    floor = jnp.exp(-decay)
    return 2 * (jnp.exp(-decay * distance / reach) - floor) / (1 - floor) - 1


def progress(distance_before: Array, distance: Array, scale: float) -> Float[Array, "*B"]:
    """R_prog = beta (d_{t-1} - d_t), both to the gate that was the target before the step."""
    return scale * (distance_before - distance)


def misalignment(velocity_w: Float[Array, "3 *B"], to_gate_w: Float[Array, "3 *B"]) -> Float[Array, "*B"]:
    """R_align = 1 - cos(velocity, direction to the gate); 0 at rest."""
    speed = norm(velocity_w)
    distance = norm(to_gate_w)
    cosine = dot(velocity_w, to_gate_w) / jnp.maximum(speed * distance, EPSILON)
    return jnp.where(speed > EPSILON, 1 - cosine, 0.0)


def speed_match(speed: Array, v_min: Array | float, zero_at: str = "v_min") -> Float[Array, "*B"]:
    """R_speed = -|v - v_min|, highest at v_min; zero there, as printed, or zero at rest."""
    return (v_min if zero_at == "rest" else 0.0) - jnp.abs(speed - v_min)


def lead_of(offset_w: Float[Array, "3 *B"], velocity_w: Float[Array, "3 *B"]) -> Float[Array, "*B"]:
    """proj_ij = (x_j - x_i) . v_i, whose sign alone matters: positive while j is ahead of i along i's heading."""
    return dot(offset_w, velocity_w)


def reward_terms(weights: RewardWeights) -> tuple[RewardTerm, ...]:
    """The terms of the reward with these weights; the stage decides on two."""
    w = weights
    return (
        RewardTerm("prox", "flight", w.w_prox, functools.partial(_prox, w), PROX),
        RewardTerm("prog", "flight", w.w_prog, functools.partial(_prog, w), PROG),
        RewardTerm("align", "flight", -w.w_align, _misaligned, "1 - cos(velocity, direction to the gate)"),
        RewardTerm("speed", "flight", w.w_speed, functools.partial(_speed, w), SPEED),
        RewardTerm("gate", "passing", w.gate_bonus, lambda step: jnp.ones_like(step.speed), "1"),
        RewardTerm("edge", "passing", -w.w_edge, functools.partial(_outside, w), EDGE),
        RewardTerm("beside", "flight", -w.w_beside, functools.partial(_beside, w), BESIDE),
        RewardTerm("near", "interaction", -w.w_near, functools.partial(_too_near, w), NEAR),
        RewardTerm("coll", "interaction", lambda rules: -rules.w_coll, lambda step: step.collided, "1 in a collision"),
        RewardTerm("over", "interaction", lambda rules: rules.w_over, functools.partial(_overtaken, w), OVER),
    )


PROX = "2 (exp(-a x) - exp(-a)) / (1 - exp(-a)) - 1 with x = distance to the gate / 10 m, a = 2"
PROG = "beta (distance before - distance after) with beta = `progress_scale`"
SPEED = "-abs(v - v_min), counted from `speed_zero_at`"
EDGE = "metres that the crossing lies outside the opening shrunk by `edge_margin`"
BESIDE = "metres that a way past the target, or past the gate before it, is nearer to the frame than `beside_margin`"
NEAR = "metres that the nearest opponent is closer than `near_distance`"
OVER = "opponents within `overtake_range` that fell behind in this step"


def _prox(weights: RewardWeights, step: StepView) -> Float[Array, "N *B"]:
    return proximity(step.shared(_to_go, weights)[1], weights.proximity_decay, weights.proximity_range)


def _prog(weights: RewardWeights, step: StepView) -> Float[Array, "N *B"]:
    before, after = step.shared(_to_go, weights)
    made = progress(before, after, weights.progress_scale)
    if not weights.pay_up_to_v_min:
        return made
    return jnp.minimum(1.0, step.rules.v_min / jnp.maximum(step.speed, EPSILON)) * made


def _to_go(step: StepView, weights: RewardWeights) -> tuple[Array, Array]:
    """Distance to the target gate before and after the step [m]: to its centre, or to its opening."""
    if weights.progress_to == "centre":
        return norm(step.before.gate_w() - step.start_w), norm(step.gate_after.position_w - step.end_w)
    before = step.before.to_opening(step.start_w, weights.edge_margin)
    return before, step.before.to_opening(step.end_w, weights.edge_margin, step.gate_after)


def _misaligned(step: StepView) -> Float[Array, "N *B"]:
    return misalignment(step.velocity_w, step.gate_after.position_w - step.end_w)


def _speed(weights: RewardWeights, step: StepView) -> Float[Array, "N *B"]:
    return speed_match(step.speed, step.rules.v_min, weights.speed_zero_at)


def _outside(weights: RewardWeights, step: StepView) -> Float[Array, "N *B"]:
    return jnp.maximum(step.crossing.offset + weights.edge_margin, 0.0)


def _beside(weights: RewardWeights, step: StepView) -> Float[Array, "N *B"]:
    """Of the planes of both gates, in either direction: who turns back past a frame must keep clear of it, too."""
    view, total = step.before, jnp.zeros(step.airborne.shape)
    for ahead in (0, LAST):
        plane = cross_opening(view.gate(ahead), step.start_w, step.end_w)
        room = plane.offset - view.frame_width
        lacks = jnp.clip(weights.beside_margin - room, 0.0, weights.beside_margin)
        total += jnp.where((plane.ahead | plane.back) & (plane.offset > 0), lacks, 0.0)
    return total


def _too_near(weights: RewardWeights, step: StepView) -> Float[Array, "N *B"]:
    return jnp.maximum(weights.near_distance - step.nearest, 0.0)


def _overtaken(weights: RewardWeights, step: StepView) -> Float[Array, "N *B"]:
    return overtakes(step, weights.overtake_range, weights.overtake_sign)


def overtakes(step: StepView, reach: float, sign: str) -> Float[Array, "N *B"]:
    """R_over: opponents nearer than `reach` that went from ahead to behind.

    `sign="paper"` keeps the printed sign, the opposite.
    """
    airborne = step.airborne

    def visit(count: Array, _: Array | int, start_w: Array, end_w: Array, here: Array) -> Array:
        before = lead_of(start_w - step.start_w, step.velocity0_w)
        offset = end_w - step.end_w
        after = lead_of(offset, step.velocity_w)
        if sign == "paper":
            before, after = -before, -after
        return count + ((before > 0) & (after < 0) & airborne & here & (dot(offset, offset) < reach**2))

    none = jnp.zeros(airborne.shape)
    count: Array = over_opponents(visit, none, (step.start_w, 1), (step.end_w, 1), (airborne, 0))
    return count
