"""Equations of motion of a quadrotor under a collective thrust and a body torque."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Vehicle
from cruise.dynamics.types import RigidBody
from cruise.vector import sin_cos

MIN_COS_PITCH = 1e-6  # Euler rates are singular at a pitch of 90 degrees; kept finite there


class Wrench(NamedTuple):
    """What the rotors exert on the body."""

    collective_thrust: Float[Array, "*B"]  # along +z of the body [N]
    body_torque_b: Float[Array, "3 *B"]  # [N m]


Derivative = Callable[[RigidBody, Wrench], RigidBody]


def thrust_axis_w(euler: Float[Array, "3 *B"]) -> Float[Array, "3 *B"]:
    """Third column of R_WB = Rz(yaw) Ry(pitch) Rx(roll): the body's z axis in the world."""
    roll, pitch, yaw = euler
    (sin_roll, cos_roll), (sin_pitch, cos_pitch), (sin_yaw, cos_yaw) = sin_cos(roll), sin_cos(pitch), sin_cos(yaw)
    return jnp.stack(
        [
            cos_yaw * sin_pitch * cos_roll + sin_yaw * sin_roll,
            sin_yaw * sin_pitch * cos_roll - cos_yaw * sin_roll,
            cos_pitch * cos_roll,
        ]
    )


def euler_rates(euler: Float[Array, "3 *B"], angular_velocity_b: Float[Array, "3 *B"]) -> Float[Array, "3 *B"]:
    """W(Theta) omega: rates of roll, pitch and yaw [rad/s]."""
    roll, pitch, _ = euler
    p, q, r = angular_velocity_b
    (sin_roll, cos_roll), (sin_pitch, cos_pitch) = sin_cos(roll), sin_cos(pitch)
    cos_pitch = jnp.where(jnp.abs(cos_pitch) > MIN_COS_PITCH, cos_pitch, MIN_COS_PITCH)
    turn = (q * sin_roll + r * cos_roll) / cos_pitch  # yaw rate
    return jnp.stack([p + turn * sin_pitch, q * cos_roll - r * sin_roll, turn])


def make_derivative(vehicle: Vehicle) -> Derivative:
    """Newton's and Euler's equations of the paper's Sec. 3.1.1 for a body with principal axes x, y, z."""
    jx, jy, jz = vehicle.inertia

    def derivative(body: RigidBody, wrench: Wrench) -> RigidBody:
        ax, ay, az = thrust_axis_w(body.euler) * (wrench.collective_thrust / vehicle.mass)
        p, q, r = body.angular_velocity_b
        tx, ty, tz = wrench.body_torque_b
        angular_acceleration = jnp.stack(
            [
                (tx - (jz - jy) * q * r) / jx,
                (ty - (jx - jz) * p * r) / jy,
                (tz - (jy - jx) * p * q) / jz,
            ]
        )
        return RigidBody(
            position_w=body.velocity_w,
            velocity_w=jnp.stack([ax, ay, az - vehicle.gravity]),
            euler=euler_rates(body.euler, body.angular_velocity_b),
            angular_velocity_b=angular_acceleration,
        )

    return derivative
