"""A quadrotor flown by collective thrust and body rates: rate loop, mixer, rotors, drag, delay, battery, body."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.config import Airframe, Vehicle
from cruise.dynamics import quaternion
from cruise.dynamics.battery import discharge, ideal_power, supply
from cruise.dynamics.delay import commands_to_keep, in_effect
from cruise.dynamics.downwash import induced_air_w
from cruise.dynamics.integrators import make_integrator
from cruise.dynamics.parameters import AS_BUILT, Parameters, Physics, physics_of
from cruise.dynamics.rigid_body import Wrench, make_free_derivative
from cruise.dynamics.rotors import Demand, Lag, follow, lag_over, rotor_thrusts, saturate, scaled
from cruise.dynamics.tracking import demanded_acceleration, towards, within_thrust
from cruise.dynamics.types import DroneState, Dynamics, FreeBody, Reference
from cruise.vector import stored

ACTION_SIZE = 4


class Memory(NamedTuple):
    """What a quadrotor has beside its body."""

    wrench: Float[Array, "4 *B"]  # of the rotors: collective thrust [N], torque about x, y, z [N m]
    commands: Float[Array, "H 4 *B"]  # actions of the steps before, newest first, in [-1, 1]
    charge: Float[Array, "*B"] | None  # of the battery, in [0, 1]; None without one


class Setpoint(NamedTuple):
    """What an action asks for."""

    thrust: Float[Array, "*B"]  # collective, per mass [m/s^2]
    rates_b: quaternion.Three  # [rad/s]


def setpoint(airframe: Airframe, action: Float[Array, "4 *B"], agility: Array | float) -> Setpoint:
    """Give c = agility (a_0 + 1) / 2 and omega = a_1..3 omega_max."""
    collective, *turns = action
    roll, pitch, yaw = (turn * rate for turn, rate in zip(turns, airframe.rates.highest, strict=True))
    return Setpoint((collective + 1) / 2 * agility, (roll, pitch, yaw))


def rate_loop(vehicle: Vehicle, lag: Any, asked: Setpoint, rates_b: quaternion.Vector) -> Demand:
    """T = m c and tau = J (omega_c - omega) / t + omega x J omega, with the mass and inertia that the controller knows.

    So the body's rates follow with the time constant t where rotors neither lag nor saturate (Faessler et al. 2017).
    """
    (jx, jy, jz), (p, q, r), (wanted_p, wanted_q, wanted_r) = vehicle.inertia, rates_b, asked.rates_b
    roll = jx * (wanted_p - p) / lag + (jz - jy) * q * r
    pitch = jy * (wanted_q - q) / lag + (jx - jz) * p * r
    yaw = jz * (wanted_r - r) / lag + (jy - jx) * p * q
    return Demand(vehicle.mass * asked.thrust, (roll, pitch, yaw))


def _apart(body: FreeBody) -> FreeBody:
    """Components apart."""
    return FreeBody(*(tuple(vector) for vector in body))


def _together(body: FreeBody) -> FreeBody:
    return FreeBody(*(jnp.stack(list(vector)) for vector in body))


def make_quadrotor(vehicle: Vehicle) -> Dynamics:
    """The vehicle as pure functions; `docs/vehicles.md` has its equations."""
    airframe = vehicle.airframe
    assert airframe is not None
    dt = vehicle.control_dt / vehicle.substeps
    kept = commands_to_keep(max(airframe.delay, airframe.longest_delay), vehicle.control_dt)
    hover = 2 * vehicle.gravity / vehicle.agility - 1

    def init(position_w: Array, heading: Array, parameters: Parameters = AS_BUILT) -> DroneState:
        zero, shape = jnp.zeros_like(position_w), position_w.shape[1:]
        body = FreeBody(position_w, zero, quaternion.from_heading(heading), zero)
        one = jnp.ones(shape, position_w.dtype)
        wrench = jnp.concatenate([vehicle.mass * vehicle.gravity * one[None], zero])
        command = jnp.concatenate([hover * one[None], zero])
        commands = jnp.broadcast_to(command, (kept, *command.shape))
        return DroneState(body, Memory(wrench, commands, one if airframe.battery else None), parameters)

    def step(
        state: DroneState, action: Float[Array, "4 *B"], agility: Array | float, air_w: Array | None = None
    ) -> DroneState:
        body, memory, physics = state.body, state.memory, physics_of(vehicle, state.parameters)
        assert isinstance(body, FreeBody)
        action = jnp.clip(action, -1.0, 1.0)
        asked = [setpoint(airframe, command, agility) for command in (action, *memory.commands)]
        share, charge = _sag(vehicle, memory)
        moving = Motion(vehicle, physics, physics.thrust_gain * share, _air(physics, air_w))
        lag = lag_over(dt, physics.rotor_lag)

        def substep(i: Any, carry: tuple[FreeBody, Demand]) -> tuple[FreeBody, Demand]:
            now = _in_effect(asked, physics.delay, i * dt, vehicle.control_dt, dt)
            return moving.advance(*carry, now, lag, dt)

        start = (_apart(body), _demand(memory.wrench))
        end, wrench = jax.lax.fori_loop(0, vehicle.substeps, substep, start)
        commands = jnp.concatenate([action[None], memory.commands[:-1]])
        memory = Memory(jnp.stack([wrench.thrust, *wrench.torque]), commands, charge)
        return DroneState(_above_ground(_together(end)), memory, state.parameters)

    def rotation(state: DroneState) -> Array:
        return quaternion.rotation_matrix(_attitude(state))

    def proprioception(state: DroneState) -> tuple[Array, ...]:
        turn = rotation(state)
        rates = state.angular_velocity_b / jnp.array(airframe.rates.highest).reshape(3, *(1,) * (turn.ndim - 2))
        rates_w = turn[:, 0] * rates[0] + turn[:, 1] * rates[1] + turn[:, 2] * rates[2]
        return turn[:, 2], turn[:, 0], rates_w

    def internal(state: DroneState) -> Array:
        highest = airframe.rates.highest
        rates = [rate / limit for rate, limit in zip(state.angular_velocity_b, highest, strict=True)]
        return jnp.concatenate([jnp.stack(rates), state.memory.commands[0]])

    def track(state: DroneState, reference: Reference, agility: Array | float) -> Array:
        demand = demanded_acceleration(vehicle.tracking, state, reference)
        turn = rotation(state)
        drag = airframe.drag.horizontal / vehicle.mass * state.velocity_w  # fed forward, as Faessler et al. 2018 do
        force = (demand + drag).at[2].add(vehicle.gravity)
        force = within_thrust(force, vehicle.gravity, agility)
        thrust, rates = towards(force, turn, reference.heading, vehicle.tracking.attitude_gain)
        limits = zip(rates, airframe.rates.highest, strict=True)
        return jnp.clip(jnp.stack([2 * thrust / agility - 1, *(rate / limit for rate, limit in limits)]), -1.0, 1.0)

    def induced_air(state: DroneState, airborne: Bool[Array, "N *B"]) -> Array:
        axis = jnp.stack(list(quaternion.thrust_axis_w(_attitude(state))))
        return induced_air_w(airframe.rotors, state.position_w, axis, state.memory.wrench[0], airborne)

    return Dynamics(
        ACTION_SIZE,
        vehicle.control_dt,
        init,
        step,
        euler=lambda state: quaternion.to_euler(_attitude(state)),
        proprioception=proprioception,
        rotation=rotation,
        internal=internal,
        track=track,
        action_frame="body",
        induced_air=induced_air if airframe.downwash else None,
    )


class Motion(NamedTuple):
    """What one control step of flight depends on beside its state."""

    vehicle: Vehicle
    physics: Physics
    gain: Any  # of the rotors
    air_w: Any  # [m/s], component by component, or None

    def advance(self, body: FreeBody, wrench: Demand, asked: Setpoint, lag: Lag, dt: float) -> tuple[FreeBody, Demand]:
        """Body and wrench after one sub-step: the rate loop looks once, the rotors follow, the body moves."""
        assert self.vehicle.airframe is not None
        demand = rate_loop(self.vehicle, self.physics.rate_lag, asked, body.angular_velocity_b)
        demand = jax.tree.map(stored, saturate(self.vehicle.airframe.rotors, demand))
        mean, wrench = follow(lag, wrench, demand)
        exerted = scaled(mean, self.gain)
        derivative = make_free_derivative(self.physics, self.vehicle.gravity, self.air_w)
        body = make_integrator(self.vehicle.integrator, derivative, dt, substeps=1)(body, exerted)
        return body._replace(attitude=quaternion.normalise(body.attitude)), wrench


def _attitude(state: DroneState) -> Float[Array, "4 *B"]:
    assert isinstance(state.body, FreeBody)
    return state.body.attitude


def _demand(wrench: Float[Array, "4 *B"]) -> Demand:
    thrust, *torque = wrench
    return Demand(thrust, tuple(torque))


def _in_effect(asked: list[Setpoint], delay: Any, elapsed: Any, control_dt: float, dt: float) -> Setpoint:
    return jax.tree.map(lambda *each: in_effect(each, delay, elapsed, control_dt, dt), *asked)


def _air(physics: Physics, air_w: Array | None) -> Any:
    """Wind and what other drones make of the air, component by component; None where it stands still."""
    if physics.wind_w is None or air_w is None:
        moved = physics.wind_w if air_w is None else air_w
        return None if moved is None else tuple(moved)
    return tuple(wind + air for wind, air in zip(physics.wind_w, air_w, strict=True))


def _sag(vehicle: Vehicle, memory: Memory) -> tuple[Array | float, Array | None]:
    """Share of their thrust that the rotors give in this step, and the battery's charge after it."""
    airframe = vehicle.airframe
    assert airframe is not None
    if airframe.battery is None or memory.charge is None:
        return 1.0, None
    thrusts = rotor_thrusts(airframe.rotors, Wrench(memory.wrench[0], memory.wrench[1:]))
    now = supply(airframe.battery, ideal_power(airframe.rotors, thrusts), memory.charge)
    return now.thrust_share, discharge(airframe.battery, memory.charge, now.current, vehicle.control_dt)


def _above_ground(body: FreeBody) -> FreeBody:
    """The ground stops what sinks into it; whether touching it is a crash is a matter of the rules."""
    x, y, z = body.position_w
    vx, vy, vz = body.velocity_w
    on_ground = z <= 0
    return body._replace(
        position_w=jnp.stack([x, y, jnp.maximum(z, 0.0)]),
        velocity_w=jnp.stack([vx, vy, jnp.where(on_ground, jnp.maximum(vz, 0.0), vz)]),
    )
