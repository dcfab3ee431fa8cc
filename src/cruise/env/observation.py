"""What a drone sees: the paper's vector, and an `extended` one in which the order of opponents means nothing."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from cruise.dynamics.types import Dynamics
from cruise.env.types import RaceState
from cruise.racing.course import Course, pick
from cruise.racing.field import opponent, opponents
from cruise.vector import dot, norm, sin_cos

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
EXTENDED_LIMIT = 3.0
ABSENT = 1e6  # sorts an opponent that left the air behind all others [m]


def extended_observation(course: Course, dynamics: Dynamics, state: RaceState) -> Float[Array, "O N *B"]:
    """Own flight, the next three gates, and opponents nearest first with their velocities.

    Size 20 + P + 7 (N - 1), where P is the vehicle's proprioception. Clipped to [-3, 3].
    """
    position, velocity = state.drones.position_w, state.drones.velocity_w
    gates = [(state.next_gate + ahead) % course.num_gates for ahead in range(3)]
    target, second, third = (pick(course.position_w, g) for g in gates)
    to_gate = target - position
    distance = norm(to_gate)
    closing = dot(velocity, to_gate) / (distance + EPSILON)
    parts = [
        to_gate / GATE_RANGE,
        distance[None] / DISTANCE_MAX,
        (second - target) / DISTANCE_MAX,
        (third - second) / DISTANCE_MAX,
        pick(course.normal_w, gates[0]),
        pick(course.normal_w, gates[1]),
        velocity / SPEED_RANGE,
        closing[None] / SPEED_RANGE,
        position[2:] / HEIGHT_RANGE,
        jnp.ones_like(distance)[None],
        dynamics.proprioception(state.drones),
    ]
    parts += _nearest_first(position, velocity, state.airborne)
    return jnp.clip(jnp.concatenate(parts), -EXTENDED_LIMIT, EXTENDED_LIMIT)


def _nearest_first(position: Array, velocity: Array, airborne: Array) -> list[Float[Array, "7 N *B"]]:
    """Seven numbers per opponent: relative position and velocity, closeness; all 0 for one that left the air."""
    features, separations = [], []
    for k in opponents(airborne.shape[0]):
        here = opponent(airborne, k, 0)
        offset, motion = opponent(position, k, 1) - position, opponent(velocity, k, 1) - velocity
        separation = norm(offset)
        seen = jnp.concatenate([offset / OPPONENT_RANGE, motion / OPPONENT_RANGE, jnp.exp(-separation)[None]])
        features.append(jnp.where(here, seen, 0.0))
        separations.append(jnp.where(here, separation, ABSENT))
    places = ranks(separations)
    slots = range(len(features))
    return [sum(jnp.where(place == slot, f, 0.0) for f, place in zip(features, places, strict=True)) for slot in slots]


def ranks(values: list[Float[Array, "*B"]]) -> list[Int[Array, "*B"]]:
    """Place of each value in ascending order, ties in order of the list.

    By counting, because XLA's sort calls its comparison element by element on the CPU.
    """
    places = [jnp.zeros(v.shape, jnp.int32) for v in values]
    for i in range(len(values)):
        for j in range(i + 1, len(values)):
            later_first = (values[j] < values[i]).astype(jnp.int32)
            places[i] += later_first
            places[j] += 1 - later_first
    return places


OBSERVATIONS = {"paper": paper_observation, "extended": extended_observation}
