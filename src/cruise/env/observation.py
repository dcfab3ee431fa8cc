"""What a drone sees: the paper's vector, and an `extended` one in which the order of opponents means nothing."""

import functools
import operator
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.dynamics.types import Dynamics
from cruise.env.observation_body import NOTICE as BODY_NOTICE
from cruise.env.observation_body import body_observation, noticed
from cruise.env.ranks import ranks
from cruise.env.types import RaceState
from cruise.racing.course import Course, pick
from cruise.racing.field import all_opponents, opponent, opponents
from cruise.vector import dot, norm, sin_cos, stored

DISTANCE_MAX = 10.0  # d_max of the paper [m]
SPEED_MAX = 10.0  # v_max of the paper [m/s]
EPSILON = 1e-6


def paper_observation(course: Course, dynamics: Dynamics, state: RaceState) -> Float[Array, "O N *B"]:
    """The paper's state vector, clipped to [-1, 1]; size 13 + G + 4 (N - 1).

    An opponent that has left the air is reported as far away: at no offset and at the largest distance.
    """
    position, velocity = state.drones.position_w, state.drones.velocity_w
    to_gate = pick(course.position_w, state.next_gate) - position
    distance = norm(to_gate)
    closing = dot(velocity, to_gate) / (distance + EPSILON)
    cos_gate, sin_gate = pick(course.normal_w, state.next_gate)
    yaw = dynamics.euler(state.drones)[2]
    sin_yaw, cos_yaw = sin_cos(yaw)
    one_hot = jax.nn.one_hot(state.next_gate, course.num_gates, axis=0)
    parts = [
        to_gate / DISTANCE_MAX,
        distance[None] / DISTANCE_MAX,
        velocity / SPEED_MAX,
        closing[None] / SPEED_MAX,
        one_hot,
        position / DISTANCE_MAX,
        jnp.stack([sin_yaw * cos_gate - cos_yaw * sin_gate, cos_yaw * cos_gate + sin_yaw * sin_gate]),
    ]
    parts += _paper_opponents(position, state.airborne)
    return jnp.clip(jnp.concatenate(parts), -1.0, 1.0)


def _paper_opponents(position: Array, airborne: Array) -> list[Array]:
    offsets, separations = [], []
    for k in opponents(airborne.shape[0]):
        here = opponent(airborne, k, 0)
        offset = jnp.where(here, opponent(position, k, 1) - position, 0.0)
        offsets.append(offset / DISTANCE_MAX)
        separations.append(jnp.where(here, norm(offset) / DISTANCE_MAX, 1.0)[None])
    return offsets + separations


GATE_RANGE, OPPONENT_RANGE, SPEED_RANGE, HEIGHT_RANGE = 5.0, 3.0, 5.0, 4.0  # scales of the extended observation
NOTICE = 5.0  # an opponent farther away than this is not seen, one within half of it is seen whole [m]
LOOK_AHEAD = 3.0  # how far constant velocity is trusted [s]
MIN_CLOSING_SPEED = 0.5  # [m/s]
LIMIT = 3.0  # the extended observation is clipped to [-LIMIT, LIMIT]
ABSENT = 1e6  # sorts an opponent that left the air behind all others [m]


def to_gate_frame(normal_w: Float[Array, "2 *#B"], vector_w: Float[Array, "3 *#B"]) -> Float[Array, "3 *#B"]:
    """A world vector along (forward, left, up) of a gate whose normal is (cos yaw, sin yaw)."""
    (cos_yaw, sin_yaw), (x, y, z) = normal_w, vector_w
    return jnp.stack([cos_yaw * x + sin_yaw * y, cos_yaw * y - sin_yaw * x, z])


def from_gate_frame(normal_w: Float[Array, "2 *B"], vector: Float[Array, "3 *B"]) -> Float[Array, "3 *B"]:
    """The inverse of `to_gate_frame`."""
    (cos_yaw, sin_yaw), (forward, left, up) = normal_w, vector
    return jnp.stack([cos_yaw * forward - sin_yaw * left, sin_yaw * forward + cos_yaw * left, up])


def extended_observation(course: Course, dynamics: Dynamics, state: RaceState) -> Float[Array, "O N *B"]:
    """Own flight, the next three gates, and opponents nearest first, all in the frame of the target gate.

    Seen so, every gate looks alike, and what is learned at one serves at all. Beyond the paper's vector it knows the
    drone's own attitude, the gates after the target, where the drone would cross the target's plane and how near it
    would come to each opponent if everybody kept his velocity. Size 20 + 3 P + 9 (N - 1) with P vectors of the
    vehicle's proprioception. Clipped to [-3, 3].
    """
    gates = [(state.next_gate + ahead) % course.num_gates for ahead in range(3)]
    target, second, third = (pick(course.position_w, g) for g in gates)
    normal = pick(course.normal_w, gates[0])
    next_x, next_y = pick(course.normal_w, gates[1])
    place = to_gate_frame(normal, state.drones.position_w - target)
    velocity = to_gate_frame(normal, state.drones.velocity_w)
    distance = norm(place)
    parts = [
        place / GATE_RANGE,
        distance[None] / DISTANCE_MAX,
        to_gate_frame(normal, second - target) / DISTANCE_MAX,
        to_gate_frame(normal, third - second) / DISTANCE_MAX,
        to_gate_frame(normal, jnp.stack([next_x, next_y, jnp.zeros_like(next_x)]))[:2],
        velocity / SPEED_RANGE,
        -dot(velocity, place)[None] / (distance + EPSILON) / SPEED_RANGE,
        state.drones.position_w[2:] / HEIGHT_RANGE,
        *_predicted_crossing(place, velocity),
        *(to_gate_frame(normal, vector) for vector in dynamics.proprioception(state.drones)),
        *_nearest_first(normal, state),
    ]
    return jnp.clip(jnp.concatenate(parts), -LIMIT, LIMIT)


def _predicted_crossing(place: Float[Array, "3 *B"], velocity: Float[Array, "3 *B"]) -> list[Array]:
    """Where, left and up of the target's centre [2 m], and when [LOOK_AHEAD] the drone would cross its plane."""
    time = jnp.clip(-place[0] / jnp.maximum(velocity[0], MIN_CLOSING_SPEED), 0.0, LOOK_AHEAD)
    return [(place[1:] + velocity[1:] * time) / 2.0, time[None] / LOOK_AHEAD]


def _nearest_first(normal: Array, state: RaceState) -> list[Float[Array, "9 N *B"]]:
    """Nine numbers per opponent, all 0 for one that left the air or is far away.

    Relative position and velocity, closeness, and time and closeness of the nearest approach at constant velocity. They
    fade out with distance: where a drone that no race ever showed is far off, the policy flies as if it were alone.
    """
    position, velocity = state.drones.position_w, state.drones.velocity_w
    drones = position.shape[1]
    if drones == 1:
        return []
    here = all_opponents(state.airborne, 0)
    offset, motion = (all_opponents(vector, 1) - vector[:, None] for vector in (position, velocity))
    separation = norm(offset)
    time = jnp.clip(-dot(offset, motion) / jnp.maximum(dot(motion, motion), 0.01), 0.0, LOOK_AHEAD)
    closeness = [jnp.exp(-separation), time / LOOK_AHEAD, jnp.exp(-norm(offset + motion * time))]
    vectors = [to_gate_frame(normal[:, None], vector) / OPPONENT_RANGE for vector in (offset, motion)]
    seen = jnp.clip(jnp.concatenate([*vectors, jnp.stack(closeness)]), -LIMIT, LIMIT)
    features = jnp.where(here, noticed(separation, NOTICE) * seen, 0.0)
    places = [stored(place.astype(jnp.float32)) for place in ranks(list(jnp.where(here, separation, ABSENT)))]

    def at(slot: int) -> Array:
        chosen = [jnp.where(place == slot, features[:, k], 0.0) for k, place in enumerate(places)]
        return functools.reduce(operator.add, chosen)

    return [at(slot) for slot in range(drones - 1)]


def own_action(course: Course, next_gate: Int[Array, "*B"], action: Float[Array, "A *B"]) -> Float[Array, "A *B"]:
    """What a policy says is the action, in whatever frame the vehicle takes it."""
    del course, next_gate
    return action


def gate_action(course: Course, next_gate: Int[Array, "*B"], action: Float[Array, "A *B"]) -> Float[Array, "A *B"]:
    """A policy on the extended observation speaks in the frame of its target gate: turn its action into the world."""
    return from_gate_frame(pick(course.normal_w, next_gate), action)


OBSERVATIONS: dict[str, Callable[[Course, Dynamics, RaceState], Array]] = {
    "paper": paper_observation,
    "extended": extended_observation,
    **{kind: functools.partial(body_observation, notice=notice) for kind, notice in BODY_NOTICE.items()},
}
FOR_ANY_FIELD = frozenset(BODY_NOTICE)  # do not depend on the number of drones; the same numbers


def action_decoder(kind: str, dynamics: Dynamics) -> Callable[[Course, Array, Array], Array]:
    """How what a policy on one kind of observation says becomes the vehicle's action.

    Only directions in the world can be given in a gate's frame; thrust and body rates are the body's own.
    """
    return gate_action if kind == "extended" and dynamics.action_frame == "world" else own_action
