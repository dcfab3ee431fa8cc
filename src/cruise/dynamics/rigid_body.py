"""Equations of motion of a quadrotor under a collective thrust and a body torque."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.config import Vehicle
from cruise.dynamics import quaternion
from cruise.dynamics.algebra import JAX, Algebra
from cruise.dynamics.drag import drag_force_w
from cruise.dynamics.parameters import Physics
from cruise.dynamics.types import FreeBody, RigidBody
from cruise.vector import sin_cos

MIN_COS_PITCH = 1e-6  # Euler rates are singular at a pitch of 90 degrees; kept finite there


class Wrench(NamedTuple):
    """What the rotors exert on the body."""

    collective_thrust: quaternion.Component  # [*B] along +z of the body [N]
    body_torque_b: quaternion.Vector  # [3, *B] N m


Derivative = Callable[[Any, Wrench], Any]  # of a body, a RigidBody or a FreeBody


def thrust_axis_w(euler: quaternion.Vector, algebra: Algebra = JAX) -> quaternion.Vector:
    """Third column of R_WB = Rz(yaw) Ry(pitch) Rx(roll): the body's z axis in the world [3, *B]."""
    roll, pitch, yaw = euler
    (sin_roll, cos_roll), (sin_pitch, cos_pitch), (sin_yaw, cos_yaw) = map(algebra.sin_cos, (roll, pitch, yaw))
    return algebra.stack(
        [
            cos_yaw * sin_pitch * cos_roll + sin_yaw * sin_roll,
            sin_yaw * sin_pitch * cos_roll - cos_yaw * sin_roll,
            cos_pitch * cos_roll,
        ]
    )


def rotation_matrix(euler: Float[Array, "3 *B"]) -> Float[Array, "3 3 *B"]:
    """R_WB: its columns are the body's axes in the world."""
    roll, pitch, yaw = euler
    (sin_roll, cos_roll), (sin_pitch, cos_pitch), (sin_yaw, cos_yaw) = sin_cos(roll), sin_cos(pitch), sin_cos(yaw)
    ahead = jnp.stack([cos_yaw * cos_pitch, sin_yaw * cos_pitch, -sin_pitch])
    left = jnp.stack(
        [
            cos_yaw * sin_pitch * sin_roll - sin_yaw * cos_roll,
            sin_yaw * sin_pitch * sin_roll + cos_yaw * cos_roll,
            cos_pitch * sin_roll,
        ]
    )
    return jnp.stack([ahead, left, thrust_axis_w(euler)], axis=1)


def euler_rates(
    euler: quaternion.Vector, angular_velocity_b: quaternion.Vector, algebra: Algebra = JAX
) -> quaternion.Vector:
    """W(Theta) omega: rates of roll, pitch and yaw [3, *B] rad/s."""
    roll, pitch, _ = euler
    p, q, r = angular_velocity_b
    (sin_roll, cos_roll), (sin_pitch, cos_pitch) = algebra.sin_cos(roll), algebra.sin_cos(pitch)
    cos_pitch = algebra.where(abs(cos_pitch) > MIN_COS_PITCH, cos_pitch, MIN_COS_PITCH)
    turn = (q * sin_roll + r * cos_roll) / cos_pitch  # yaw rate
    return algebra.stack([p + turn * sin_pitch, q * cos_roll - r * sin_roll, turn])


def make_derivative(vehicle: Vehicle, algebra: Algebra = JAX) -> Derivative:
    """Newton's and Euler's equations of the paper's Sec. 3.1.1 for a body with principal axes x, y, z."""
    jx, jy, jz = vehicle.inertia

    def derivative(body: RigidBody, wrench: Wrench) -> RigidBody:
        ax, ay, az = thrust_axis_w(body.euler, algebra) * (wrench.collective_thrust / vehicle.mass)
        angular_acceleration = euler_equation((jx, jy, jz), body.angular_velocity_b, wrench.body_torque_b)
        return RigidBody(
            position_w=body.velocity_w,
            velocity_w=algebra.stack([ax, ay, az - vehicle.gravity]),
            euler=euler_rates(body.euler, body.angular_velocity_b, algebra),
            angular_velocity_b=algebra.stack(list(angular_acceleration)),
        )

    return derivative


def euler_equation(inertia: Any, rates: Any, torque: Any) -> quaternion.Three:
    """Euler's equation J d(omega)/dt = tau - omega x J omega about principal axes, component by component [rad/s^2]."""
    (jx, jy, jz), (p, q, r), (tx, ty, tz) = inertia, rates, torque
    return (
        (tx - (jz - jy) * q * r) / jx,
        (ty - (jx - jz) * p * r) / jy,
        (tz - (jy - jx) * p * q) / jz,
    )


def make_free_derivative(
    physics: Physics, gravity: float, air_w: quaternion.Vector | None, algebra: Algebra = JAX
) -> Derivative:
    """Newton's and Euler's equations of a body whose attitude is a quaternion, with drag, component by component."""
    mass = physics.mass

    def derivative(body: FreeBody, wrench: Wrench) -> FreeBody:
        axis = quaternion.thrust_axis_w(body.attitude)
        lift = wrench.collective_thrust / mass
        ax, ay, az = (lift * component for component in axis)
        drag = drag_force_w(physics, body.velocity_w, air_w, axis, algebra)
        if drag is not None:
            ax, ay, az = ax + drag[0] / mass, ay + drag[1] / mass, az + drag[2] / mass
        return FreeBody(
            position_w=body.velocity_w,
            velocity_w=(ax, ay, az - gravity),
            attitude=quaternion.derivative(body.attitude, body.angular_velocity_b),
            angular_velocity_b=euler_equation(physics.inertia, body.angular_velocity_b, wrench.body_torque_b),
        )

    return derivative
