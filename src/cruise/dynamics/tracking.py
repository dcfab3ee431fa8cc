"""From a reference to what a vehicle can be told: an acceleration, or collective thrust and body rates."""

import functools
import operator
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Tracking, Vehicle
from cruise.dynamics.types import DroneState, Reference
from cruise.vector import dot, norm

LEAST_LIFT = 0.2  # share of the weight that the thrust always carries, so that a drone never turns over to go down
HIGHEST_SHARE = 0.95  # of the thrust that is asked for at most: the rest is for turning
EPSILON = 1e-6
UPSIDE_DOWN = 1e-2  # cosine of half the angle between thrust and force below which one points against the other


def demanded_velocity(tracking: Tracking, state: DroneState, reference: Reference) -> Float[Array, "3 *B"] | None:
    """Give v = v_ref + k_p (p_ref - p), without what the reference lacks; None where it has neither [m/s]."""
    if reference.position_w is None:
        return reference.velocity_w
    approach = (reference.position_gain or tracking.position_gain) * (reference.position_w - state.position_w)
    return approach if reference.velocity_w is None else reference.velocity_w + approach


def demanded_acceleration(
    tracking: Tracking, state: DroneState, reference: Reference, unit: Array | float = 1.0
) -> Float[Array, "3 *B"]:
    """Give a = a_ref + k_v (v_ref + k_p (p_ref - p) - v), without what the reference lacks, in `unit` [m/s^2]."""
    wanted_w = demanded_velocity(tracking, state, reference)
    parts = [] if reference.acceleration_w is None else [reference.acceleration_w / unit]
    if wanted_w is not None:
        parts.append((reference.velocity_gain or tracking.velocity_gain) / unit * (wanted_w - state.velocity_w))
    return functools.reduce(operator.add, parts) if parts else jnp.zeros_like(state.velocity_w)


class Attitude(NamedTuple):
    """Collective thrust per mass [m/s^2] and body rates [rad/s] that turn the thrust where it is wanted."""

    thrust: Float[Array, "*B"]
    rates_b: Float[Array, "3 *B"]


def within_thrust(
    force_w: Float[Array, "3 *B"], gravity: float, highest: Float[Array, "*#B"] | float
) -> Float[Array, "3 *B"]:
    """The force per mass nearest to what is wanted that upright rotors can give; height goes before the rest."""
    highest = HIGHEST_SHARE * highest
    up = jnp.clip(force_w[2], LEAST_LIFT * gravity, highest)
    sideways = norm(force_w[:2])
    room = jnp.sqrt(jnp.maximum(highest**2 - up * up, 0.0))
    shrink = jnp.minimum(1.0, room / jnp.maximum(sideways, EPSILON))
    return jnp.stack([force_w[0] * shrink, force_w[1] * shrink, up])


def demanded_force(
    vehicle: Vehicle, state: DroneState, reference: Reference, agility: Array | float
) -> Float[Array, "3 *B"]:
    """The force per mass of the rotors that follows a reference [m/s^2], with the airframe's linear drag fed forward.

    So do Faessler, Franchi and Scaramuzza (Differential Flatness of Quadrotor Dynamics Subject to Rotor Drag, RA-L
    2018).
    """
    assert vehicle.airframe is not None
    drag = vehicle.airframe.drag.horizontal / vehicle.mass * state.velocity_w
    x, y, z = demanded_acceleration(vehicle.tracking, state, reference) + drag
    return within_thrust(jnp.stack([x, y, z + vehicle.gravity]), vehicle.gravity, agility)


def towards(
    force_w: Float[Array, "3 *B"], rotation: Float[Array, "3 3 *B"], heading: Float[Array, "*B"] | None, gain: float
) -> Attitude:
    """Thrust and rates for a force per mass [m/s^2] on a body with attitude `rotation`.

    The thrust is the force along the present thrust axis (Lee, Leok and McClamroch, Geometric Tracking Control of a
    Quadrotor UAV on SE(3), CDC 2010). Roll and pitch rate turn that axis straight to the force, `gain` times twice the
    vector part of the shortest rotation between them (reduced attitude: Brescianini, Hehn and D'Andrea, ETH 2013); yaw
    rate turns the body's x axis to the heading, as seen from above.
    """
    own = [dot(rotation[:, axis], force_w) for axis in range(3)]  # in the body's frame
    length = jnp.maximum(norm(force_w), EPSILON)
    cosine = own[2] / length
    half = jnp.sqrt(jnp.maximum((1 + cosine) / 2, EPSILON))
    roll, pitch = -gain * own[1] / length / half, gain * own[0] / length / half
    roll = jnp.where((cosine < 0) & (half < UPSIDE_DOWN), 2 * gain, roll)  # no way is the shortest: over the side
    yaw = jnp.zeros_like(roll)
    if heading is not None:
        ahead = rotation[:2, 0]
        sine = ahead[0] * jnp.sin(heading) - ahead[1] * jnp.cos(heading)
        cosine = ahead[0] * jnp.cos(heading) + ahead[1] * jnp.sin(heading)
        yaw = gain / 2 * jnp.arctan2(sine, cosine)
    return Attitude(jnp.maximum(own[2], 0.0), jnp.stack([roll, pitch, yaw]))
