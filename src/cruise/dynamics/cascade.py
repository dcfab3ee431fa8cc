"""The paper's vehicle: a desired acceleration, through a cascade of PD laws, to thrust and torque."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from cruise.actions import acceleration
from cruise.config import Vehicle
from cruise.dynamics.algebra import JAX, Algebra
from cruise.dynamics.integrators import make_integrator
from cruise.dynamics.parameters import AS_BUILT, Parameters
from cruise.dynamics.quaternion import Vector
from cruise.dynamics.rigid_body import Wrench, make_derivative, rotation_matrix, thrust_axis_w
from cruise.dynamics.tracking import demanded_acceleration
from cruise.dynamics.types import DroneState, Dynamics, Reference, RigidBody
from cruise.terms import Term
from cruise.vector import sin_cos

RATE_SCALE = 3.0  # body rates of a hard turn [rad/s]
AGILITY_SCALE = 4.0  # a middling agility [m/s^2]


def velocity_error(action: Vector, agility: Array | float, control_dt: float, algebra: Algebra = JAX) -> Vector:
    """e_v = v_desired - v, with v_desired = v + agility clip(action, -1, 1) dt (the paper's action equation)."""
    return agility * algebra.clip(action, -1.0, 1.0) * control_dt


def commanded_acceleration(vehicle: Vehicle, error: Vector, previous_error: Vector, velocity_w: Vector) -> Vector:
    """a_cmd = K_p,pos (K_v e + K_vd (e - e_previous)) - K_d,pos v [m/s^2].

    The difference is not divided by dt: so the repository's gains were tuned.
    """
    gains = vehicle.controller
    desired = gains.velocity_p * error + gains.velocity_d * (error - previous_error)
    return gains.position_p * desired - gains.position_d * velocity_w


def wrench_from_acceleration(vehicle: Vehicle, command: Vector, body: RigidBody, algebra: Algebra = JAX) -> Wrench:
    """Thrust for the command's vertical part, torque towards the roll and pitch that give its lateral part.

    The paper prints T = m (g + a_z) without a bound; here T >= 0, because a rotor cannot pull down.
    """
    gains, g = vehicle.controller, vehicle.gravity
    thrust = algebra.maximum(vehicle.mass * (g + command[2]), 0.0)
    desired = algebra.stack([-command[1] / g, command[0] / g, algebra.zeros_like(thrust)])
    torque = gains.attitude_p * (desired - body.euler) - gains.attitude_d * body.angular_velocity_b
    return Wrench(thrust, torque)


def make_cascade(vehicle: Vehicle) -> Dynamics:
    """The vehicle as pure functions. Its memory is the velocity error of the step before."""
    integrate = make_integrator(vehicle.integrator, make_derivative(vehicle), vehicle.control_dt, vehicle.substeps)

    def init(position_w: Array, heading: Array, parameters: Parameters = AS_BUILT) -> DroneState:
        del heading, parameters  # the mapping to roll and pitch holds at yaw 0, where the attitude loop keeps the drone
        zero = jnp.zeros_like(position_w)
        return DroneState(RigidBody(position_w, zero, zero, zero), memory=zero)

    def step(state: DroneState, action: Array, agility: Array | float, air_w: Array | None = None) -> DroneState:
        del air_w  # the paper's air stands still and drags nothing
        body = _body(state)
        error = velocity_error(action, agility, vehicle.control_dt)
        command = commanded_acceleration(vehicle, error, state.memory, body.velocity_w)
        body = integrate(body, wrench_from_acceleration(vehicle, command, body))
        x, y, z = body.position_w
        on_or_above_ground = jnp.stack([x, y, jnp.maximum(z, 0.0)])
        return DroneState(body._replace(position_w=on_or_above_ground), memory=error)

    def track(state: DroneState, reference: Reference, agility: Array | float) -> Array:
        return jnp.clip(demanded_acceleration(vehicle.tracking, state, reference, agility), -1.0, 1.0)

    return Dynamics(
        acceleration(vehicle.agility),
        vehicle.control_dt,
        init,
        step,
        euler=lambda state: _body(state).euler,
        proprioception=proprioception(vehicle),
        rotation=lambda state: rotation_matrix(_body(state).euler),
        internal=internal(vehicle),
        track=track,
    )


def proprioception(vehicle: Vehicle) -> tuple[Term, ...]:
    """What the drone feels of itself, as vectors in the world's frame."""
    level = "roll and pitch rate turned level by the yaw alone, yaw rate"
    return (
        Term("thrust_axis", 3, "the body's z axis: where its thrust points", fn=_thrust_axis),
        Term("body_rates", 3, level, "rad/s", RATE_SCALE, fn=_level_rates),
        _previous_error(vehicle),
    )


def internal(vehicle: Vehicle) -> tuple[Term, ...]:
    """The same in its own frame; the controller's memory stays in the world's, in which the vehicle is commanded."""
    return (
        Term("body_rates", 3, "roll, pitch and yaw rate", "rad/s", RATE_SCALE, "body", fn=_rates_b),
        _previous_error(vehicle),
    )


def _rates_b(state: DroneState) -> Float[Array, "3 *B"]:
    return state.angular_velocity_b


def _previous_error(vehicle: Vehicle) -> Term:
    meaning = "agility x previous action x control_dt, the controller's memory"
    scale = vehicle.control_dt * AGILITY_SCALE
    return Term("previous_velocity_error", 3, meaning, "m/s", scale, fn=lambda state: state.memory)


def _thrust_axis(state: DroneState) -> Float[Array, "3 *B"]:
    return thrust_axis_w(_body(state).euler)


def _level_rates(state: DroneState) -> Float[Array, "3 *B"]:
    """The tilt is left out: it is small."""
    sin_yaw, cos_yaw = sin_cos(_body(state).euler[2])
    p, q, r = state.angular_velocity_b
    return jnp.stack([cos_yaw * p - sin_yaw * q, sin_yaw * p + cos_yaw * q, r])


def _body(state: DroneState) -> RigidBody:
    assert isinstance(state.body, RigidBody)
    return state.body
