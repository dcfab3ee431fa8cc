"""Flown by attitude: roll, pitch, yaw or yaw rate and collective thrust, through a loop around the body rates."""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import AttitudeLimits, Vehicle
from cruise.dynamics import quaternion
from cruise.dynamics.quaternion import Component, Quaternion, Three
from cruise.dynamics.tracking import EPSILON, demanded_force
from cruise.dynamics.types import DroneState, FreeBody, Reference
from cruise.vector import norm, sin_cos


class Setpoint(NamedTuple):
    """What the rate loop is asked for."""

    thrust: Component  # collective, per mass [m/s^2]
    rates_b: Three  # [rad/s]


class AttitudeSetpoint(NamedTuple):
    """What the attitude loop is asked for."""

    thrust: Component  # collective, per mass [m/s^2]
    roll: Component  # ZYX Euler angle [rad]
    pitch: Component  # likewise [rad]
    turn: Component  # yaw [rad], or yaw rate about the world's z axis [rad/s]: as `AttitudeLimits.yaw` says


def setpoint(vehicle: Vehicle, action: Float[Array, "4 *B"], agility: Array | float) -> AttitudeSetpoint:
    """Give roll = a_0 tilt, pitch = a_1 tilt, yaw a_2 psi_max or its rate a_2 omega_max, c = agility (a_3 + 1) / 2."""
    roll, pitch, turn, collective = action
    limits = _limits(vehicle)
    thrust = (collective + 1) / 2 * agility
    return AttitudeSetpoint(
        thrust, roll * limits.highest_tilt, pitch * limits.highest_tilt, turn * _highest_turn(vehicle)
    )


def attitude_loop(vehicle: Vehicle, asked: AttitudeSetpoint, attitude: Quaternion) -> Setpoint:
    """Body rates omega = 2 k sgn(w) v with (w, v) the rotation from the attitude to the one that is asked for.

    That is the law of Brescianini, Hehn and D'Andrea (Nonlinear Quadrocopter Attitude Control, ETH Zurich 2013), which
    the PX4 autopilot flies by; k is `Tracking.attitude_gain`. Where yaw is said as a rate, the attitude asked for has
    the drone's own yaw, and the rate is added about the world's vertical, as in PX4. Rates are cut to their limits.
    """
    assert vehicle.airframe is not None
    limits, gain = _limits(vehicle), vehicle.tracking.attitude_gain
    yaw = asked.turn if limits.yaw == "angle" else heading_of(attitude)
    w, *error = quaternion.between(attitude, quaternion.from_euler(asked.roll, asked.pitch, yaw))
    shortest = jnp.where(w < 0, -2 * gain, 2 * gain)
    rates = [shortest * part for part in error]
    if limits.yaw == "rate":
        rates = [rate + asked.turn * up for rate, up in zip(rates, quaternion.up_b(attitude), strict=True)]
    roll, pitch, turn = (jnp.clip(rate, -m, m) for rate, m in zip(rates, vehicle.airframe.rates.highest, strict=True))
    return Setpoint(asked.thrust, (roll, pitch, turn))


def track(vehicle: Vehicle, state: DroneState, reference: Reference, agility: Array | float) -> Float[Array, "4 *B"]:
    """The attitude and thrust that follow a reference.

    The body's z axis is asked to point along the force that is wanted, within the tilt that can be asked for, at the
    heading that is wanted; the thrust is the force along the present axis (Lee, Leok and McClamroch, CDC 2010). Without
    a heading in the reference the drone keeps the one that it has.
    """
    assert isinstance(state.body, FreeBody)
    limits, attitude = _limits(vehicle), state.body.attitude
    force = _within_tilt(demanded_force(vehicle, state, reference, agility), limits.highest_tilt)
    own = heading_of(attitude)
    wanted = own if reference.heading is None else jnp.broadcast_to(reference.heading, own.shape)
    sine, cosine = sin_cos(wanted if limits.yaw == "angle" else own)
    ahead, left = cosine * force[0] + sine * force[1], cosine * force[1] - sine * force[0]
    roll = -jnp.arcsin(jnp.clip(left / jnp.maximum(norm(force), EPSILON), -1.0, 1.0))
    pitch = jnp.arctan2(ahead, force[2])
    turn = wanted if limits.yaw == "angle" else vehicle.tracking.attitude_gain / 2 * _wrapped(wanted - own)
    axis = quaternion.thrust_axis_w(attitude)
    thrust = jnp.maximum(axis[0] * force[0] + axis[1] * force[1] + axis[2] * force[2], 0.0)
    shares = [roll / limits.highest_tilt, pitch / limits.highest_tilt, _turn_share(vehicle, turn)]
    return jnp.clip(jnp.stack([*shares, 2 * thrust / agility - 1]), -1.0, 1.0)


def yaw_share(vehicle: Vehicle, heading: Array | float) -> Array | float:
    """The number of an action that keeps a heading [rad]: 0 where yaw is said as a rate."""
    return _turn_share(vehicle, heading) if _limits(vehicle).yaw == "angle" else 0.0


def heading_of(attitude: Quaternion) -> Component:
    """Yaw of the ZYX Euler angles [rad]."""
    w, x, y, z = attitude
    return jnp.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _limits(vehicle: Vehicle) -> AttitudeLimits:
    assert vehicle.airframe is not None
    return vehicle.airframe.attitude


def _highest_turn(vehicle: Vehicle) -> float:
    """What 1 stands for in the third number: the highest yaw [rad] or yaw rate [rad/s]."""
    return vehicle.action.numbers[2].high


def _turn_share(vehicle: Vehicle, turn: Array | float) -> Array:
    angle = _limits(vehicle).yaw == "angle"
    return (_wrapped(jnp.asarray(turn)) if angle else jnp.asarray(turn)) / _highest_turn(vehicle)


def _wrapped(angle: Array) -> Array:
    """The same angle from -pi to pi [rad]."""
    return (angle + jnp.pi) % (2 * jnp.pi) - jnp.pi


def _within_tilt(force_w: Float[Array, "3 *B"], highest_tilt: float) -> Float[Array, "3 *B"]:
    """The force with its level part cut so that it leans no farther than `highest_tilt` [rad]."""
    room = force_w[2] * math.tan(highest_tilt)
    shrink = jnp.minimum(1.0, room / jnp.maximum(norm(force_w[:2]), EPSILON))
    return jnp.stack([force_w[0] * shrink, force_w[1] * shrink, force_w[2]])
