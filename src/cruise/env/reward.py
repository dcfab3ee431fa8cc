"""The paper's reward (Sec. 3.2.2), one function per component, and the project's two additions."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.config import RewardWeights
from cruise.dynamics import DroneState
from cruise.env.types import Rules
from cruise.racing.field import opponent, opponents
from cruise.racing.gates import Crossing
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


def overtakes(motion: "Motion", airborne: Bool[Array, "N *B"], reach: float, sign: str) -> Float[Array, "N *B"]:
    """R_over: opponents nearer than `reach` that went from ahead to behind.

    `sign="paper"` keeps the printed sign, the opposite.
    """
    count = jnp.zeros(airborne.shape)
    for k in opponents(airborne.shape[0]):
        before = lead_of(opponent(motion.start_w, k, 1) - motion.start_w, motion.velocity0_w)
        offset = opponent(motion.end_w, k, 1) - motion.end_w
        after = lead_of(offset, motion.velocity_w)
        if sign == "paper":
            before, after = -before, -after
        counts = airborne & opponent(airborne, k, 0) & (dot(offset, offset) < reach**2)
        count += (before > 0) & (after < 0) & counts
    return count


class Target(NamedTuple):
    """The gate each drone is flying to."""

    position_w: Float[Array, "3 *B"]  # centre [m]
    normal_w: Float[Array, "2 *B"]
    half_size: Float[Array, "2 *B"]  # [m]


def distance_to_centre(target: Target, position_w: Float[Array, "3 *B"]) -> Float[Array, "*B"]:
    """d_t of the paper [m]."""
    return norm(target.position_w - position_w)


def distance_to_opening(target: Target, position_w: Float[Array, "3 *B"], margin: float) -> Float[Array, "*B"]:
    """Distance [m] to the nearest point of the opening shrunk by `margin` on every side: no point of it is better."""
    x, y, z = position_w - target.position_w
    cos_yaw, sin_yaw = target.normal_w
    forward, left = cos_yaw * x + sin_yaw * y, cos_yaw * y - sin_yaw * x
    beside = jnp.maximum(jnp.abs(left) - jnp.maximum(target.half_size[0] - margin, 0.0), 0.0)
    above = jnp.maximum(jnp.abs(z) - jnp.maximum(target.half_size[1] - margin, 0.0), 0.0)
    return jnp.sqrt(forward**2 + beside**2 + above**2)


class Motion:
    """Quantities of one step that several components share. [m], [m/s], world frame."""

    def __init__(self, before: DroneState, after: DroneState, target: Target, weights: RewardWeights) -> None:
        self.start_w, self.end_w = before.position_w, after.position_w
        self.velocity0_w, self.velocity_w = before.velocity_w, after.velocity_w
        self.to_gate_w = target.position_w - self.end_w
        self.speed = norm(self.velocity_w)
        if weights.progress_to == "centre":
            self.distance_before = distance_to_centre(target, self.start_w)
            self.distance = distance_to_centre(target, self.end_w)
        else:
            self.distance_before = distance_to_opening(target, self.start_w, weights.edge_margin)
            self.distance = distance_to_opening(target, self.end_w, weights.edge_margin)


def reward_components(
    weights: RewardWeights, rules: Rules, motion: Motion, nearest: Array, collided: Array, airborne: Array
) -> dict[str, Float[Array, "N *B"]]:
    """Weighted components, signs included, before the gate's bonus and the clip.

    `nearest` is the closest approach to an opponent [m], `collided` any collision of the step.
    """
    w = weights
    paid = jnp.minimum(1.0, rules.v_min / jnp.maximum(motion.speed, EPSILON)) if w.pay_up_to_v_min else 1.0
    components = {
        "prox": w.w_prox * proximity(motion.distance, w.proximity_decay, w.proximity_range),
        "prog": paid * w.w_prog * progress(motion.distance_before, motion.distance, w.progress_scale),
        "align": -w.w_align * misalignment(motion.velocity_w, motion.to_gate_w),
        "speed": w.w_speed * speed_match(motion.speed, rules.v_min, w.speed_zero_at),
        "near": -w.w_near * jnp.maximum(w.near_distance - nearest, 0.0),
        "coll": -rules.w_coll * collided,
    }
    components["over"] = rules.w_over * overtakes(motion, airborne, w.overtake_range, w.overtake_sign)
    return components


def total_reward(
    weights: RewardWeights, rules: Rules, components: dict[str, Array], crossing: Crossing, terminated: Array
) -> Float[Array, "N *B"]:
    """Sum and clip; a passed gate replaces the terms of flight, the end of an episode replaces everything."""
    interaction = components["near"] + components["coll"] + components["over"]
    flight = components["prox"] + components["prog"] + components["align"] + components["speed"]
    outside = jnp.maximum(crossing.offset + weights.edge_margin, 0.0)
    passing = weights.gate_bonus - weights.w_edge * outside
    reward = jnp.where(crossing.passed, passing, flight) + interaction
    highest = jnp.where(crossing.passed, max(weights.clip, weights.gate_bonus), weights.clip)
    return jnp.where(terminated, rules.crash_share * weights.terminal, jnp.clip(reward, -weights.clip, highest))
