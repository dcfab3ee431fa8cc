"""A quadrotor with rotors, flown by collective thrust and body rates or attitude: loops, mixer, drag, battery, body."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from cruise.actions import hovering_share
from cruise.config import Airframe, Vehicle
from cruise.dynamics import attitude, quaternion
from cruise.dynamics.attitude import AttitudeSetpoint, Setpoint
from cruise.dynamics.battery import discharge, ideal_power, supply
from cruise.dynamics.delay import commands_to_keep, in_effect
from cruise.dynamics.downwash import induced_air_w
from cruise.dynamics.integrators import make_integrator
from cruise.dynamics.parameters import AS_BUILT, Parameters, Physics, physics_of
from cruise.dynamics.rigid_body import Wrench, make_free_derivative
from cruise.dynamics.rotors import Demand, Lag, curved, follow, lag_over, levers, rotor_thrusts, saturate, scaled
from cruise.dynamics.tracking import demanded_force, towards
from cruise.dynamics.types import DroneState, Dynamics, FreeBody, Reference
from cruise.terms import Term
from cruise.vector import stored


class Memory(NamedTuple):
    """What a quadrotor has beside its body."""

    wrench: Float[Array, "4 *B"]  # of the rotors: collective thrust [N], torque about x, y, z [N m]
    commands: Float[Array, "H 4 *B"]  # actions of the steps before, newest first, in [-1, 1]
    charge: Float[Array, "*B"] | None  # of the battery, in [0, 1]; None without one
    controller: Any = ()  # what the flight controller remembers: arrays [... *B]


class FlightController(NamedTuple):
    """Rate loop and mixer: what makes of a setpoint a wrench that the rotors can give.

    `demand(flight, body, wrench, asked, memory)` gives the wrench for the next sub-step, and its memory after that;
    `init(vehicle, parameters, zero)` is its memory at the start, `zero` being an array [*B] of zeros.
    """

    demand: Callable[["Flight", FreeBody, Demand, Setpoint, Any], tuple[Demand, Any]]
    init: Callable[[Vehicle, Parameters, Array], Any]


def own_law(flight: "Flight", body: FreeBody, wrench: Demand, asked: Setpoint, memory: Any) -> tuple[Demand, Any]:
    """The vehicle's own rate loop, cut to what its rotors can give. It remembers the torque of its integral, if any."""
    rotors, physics = _airframe(flight.vehicle).rotors, flight.physics
    demand = rate_loop(flight.vehicle, physics.rate_lag, asked, body.angular_velocity_b)
    if memory:
        memory = wind_up(flight, asked, body.angular_velocity_b, memory)
        demand = demand._replace(torque=tuple(p + i for p, i in zip(demand.torque, memory, strict=True)))
    cut = curved(rotors, saturate(rotors, demand, physics.clip_share, physics.min_thrust), physics.thrust_curve)
    return jax.tree.map(stored, cut), memory


def wind_up(
    flight: "Flight", asked: Setpoint, rates_b: quaternion.Vector, before: tuple[Array, ...]
) -> tuple[Array, ...]:
    """tau_I = k_I J / t times the integral of omega_c - omega [N m], after one more sub-step.

    It grows while rotors saturate as well, as in most firmware, up to the torque of rotors that differ by their range.
    """
    vehicle, physics = flight.vehicle, flight.physics
    rotors, dt = _airframe(vehicle).rotors, vehicle.control_dt / vehicle.substeps
    torques = []
    for axis, lever in enumerate(levers(rotors)):
        gain = physics.integral_gain * vehicle.inertia[axis] / physics.rate_lag
        most = 2 * lever * (rotors.max_thrust - rotors.min_thrust)
        torques.append(jnp.clip(before[axis] + gain * (asked.rates_b[axis] - rates_b[axis]) * dt, -most, most))
    return tuple(torques)


def not_wound(vehicle: Vehicle, parameters: Parameters, zero: Array) -> tuple[Array, ...]:
    """The memory of `own_law` at the start; nothing where its loop has no integral."""
    integrates = parameters.integral_gain is not None or _airframe(vehicle).rates.integral_gain > 0
    return (zero, zero, zero) if integrates else ()


OWN_LAW = FlightController(own_law, not_wound)


def make_quadrotor(vehicle: Vehicle, controller: FlightController = OWN_LAW) -> Dynamics:
    """The vehicle as pure functions; `docs/vehicles.md` has its equations.

    It is told thrust and attitude where `vehicle.control` says so, thrust and body rates otherwise.
    """
    airframe = _airframe(vehicle)
    return Dynamics(
        vehicle.own.action,
        vehicle.control_dt,
        init=partial(standing, vehicle, controller=controller),
        step=partial(step, vehicle, controller=controller),
        euler=lambda state: quaternion.to_euler(_attitude(state)),
        proprioception=proprioception(airframe),
        rotation=rotation,
        internal=internal(airframe),
        track=partial(attitude.track if _by_attitude(vehicle) else track, vehicle),
        induced_air=partial(induced_air, airframe) if airframe.downwash else None,
    )


def standing(
    vehicle: Vehicle,
    position_w: Array,
    heading: Array,
    parameters: Parameters = AS_BUILT,
    controller: FlightController = OWN_LAW,
) -> DroneState:
    """A drone that hovers at a place, level, facing `heading` [rad], its battery full."""
    airframe = _airframe(vehicle)
    zero, one = jnp.zeros_like(position_w), jnp.ones_like(position_w[:1])
    body = FreeBody(position_w, zero, quaternion.from_heading(heading), zero)
    wrench = jnp.concatenate([vehicle.mass * vehicle.gravity * one, zero])
    hovering = jnp.stack([zero[0] + share for share in hovering_action(vehicle, heading)])
    kept = commands_to_keep(max(airframe.delay, airframe.longest_delay), vehicle.control_dt)
    commands = jnp.broadcast_to(hovering, (kept, *hovering.shape))
    charge = one[0] if airframe.battery else None
    return DroneState(body, Memory(wrench, commands, charge, controller.init(vehicle, parameters, zero[0])), parameters)


def hovering_action(vehicle: Vehicle, heading: Array | float = 0.0) -> tuple[Array | float, ...]:
    """The action with which a level drone that looks along `heading` [rad] stays as it is."""
    share = hovering_share(vehicle.agility, vehicle.gravity)
    if _by_attitude(vehicle):
        return 0.0, 0.0, attitude.yaw_share(vehicle, heading), share
    return share, 0.0, 0.0, 0.0


def step(
    vehicle: Vehicle,
    state: DroneState,
    action: Float[Array, "4 *B"],
    agility: Array | float,
    air_w: Array | None = None,
    controller: FlightController = OWN_LAW,
) -> DroneState:
    """One control step: `substeps` times the rate loop looks, the rotors follow and the body moves.

    The components of the body are apart in the loop, because XLA fuses them so.
    """
    memory, physics = state.memory, physics_of(vehicle, state.parameters)
    assert isinstance(state.body, FreeBody)
    action = jnp.clip(action, -1.0, 1.0)
    asked = [_asked(vehicle, command, agility) for command in (action, *memory.commands)]
    share, charge = _sag(vehicle, memory)
    dt = vehicle.control_dt / vehicle.substeps
    lag = lag_over(dt, physics.rotor_lag)
    flight = Flight(vehicle, physics, physics.thrust_gain * share, _air(physics, air_w))

    def substep(i: Any, carry: tuple[FreeBody, Demand, Any]) -> tuple[FreeBody, Demand, Any]:
        body, wrench, memory = carry
        setpoint = _in_effect(asked, physics.delay, i * dt, vehicle.control_dt, dt)
        if isinstance(setpoint, AttitudeSetpoint):
            setpoint = attitude.attitude_loop(vehicle, setpoint, body.attitude)
        demand, memory = controller.demand(flight, body, wrench, setpoint, memory)
        return *flight.advance(body, wrench, demand, lag, dt), memory

    thrust, *torque = memory.wrench
    start = (FreeBody(*(tuple(vector) for vector in state.body)), Demand(thrust, tuple(torque)), memory.controller)
    end, wrench, remembered = jax.lax.fori_loop(0, vehicle.substeps, substep, start)
    body = _above_ground(FreeBody(*(jnp.stack(list(vector)) for vector in end)))
    commands = jnp.concatenate([action[None], memory.commands[:-1]])
    together = jnp.stack([wrench.thrust, *wrench.torque])
    return DroneState(body, Memory(together, commands, charge, remembered), state.parameters)


def setpoint(airframe: Airframe, action: Float[Array, "4 *B"], agility: Array | float) -> Setpoint:
    """Give c = agility (a_0 + 1) / 2 and omega = a_1..3 omega_max."""
    collective, *turns = action
    roll, pitch, yaw = (turn * rate for turn, rate in zip(turns, airframe.rates.highest, strict=True))
    return Setpoint((collective + 1) / 2 * agility, (roll, pitch, yaw))


def _asked(vehicle: Vehicle, action: Array, agility: Array | float) -> Setpoint | AttitudeSetpoint:
    """What an action asks for, by what the vehicle is told."""
    if _by_attitude(vehicle):
        return attitude.setpoint(vehicle, action, agility)
    return setpoint(_airframe(vehicle), action, agility)


def rates_asked(vehicle: Vehicle, action: Float[Array, "4 *B"], agility: Array | float, q: Array) -> Setpoint:
    """What an action asks of the rate loop of a drone with attitude `q`."""
    asked = _asked(vehicle, action, agility)
    return attitude.attitude_loop(vehicle, asked, q) if isinstance(asked, AttitudeSetpoint) else asked


def rate_loop(vehicle: Vehicle, lag: Any, asked: Setpoint, rates_b: quaternion.Vector) -> Demand:
    """T = m c and tau = J (omega_c - omega) / t + omega x J omega, with the mass and inertia that the controller knows.

    So the body's rates follow with the time constant t where rotors neither lag nor saturate (Faessler et al. 2017).
    """
    (jx, jy, jz), (p, q, r), (wanted_p, wanted_q, wanted_r) = vehicle.inertia, rates_b, asked.rates_b
    roll = jx * (wanted_p - p) / lag + (jz - jy) * q * r
    pitch = jy * (wanted_q - q) / lag + (jx - jz) * p * r
    yaw = jz * (wanted_r - r) / lag + (jy - jx) * p * q
    return Demand(vehicle.mass * asked.thrust, (roll, pitch, yaw))


class Flight(NamedTuple):
    """What a control step depends on beside state and action."""

    vehicle: Vehicle
    physics: Physics
    gain: Any  # of the rotors
    air_w: Any  # [m/s], component by component, or None

    def advance(self, body: FreeBody, wrench: Demand, demand: Demand, lag: Lag, dt: float) -> tuple[FreeBody, Demand]:
        """Body and wrench of the rotors after one sub-step of `dt` [s] in which a demand is held."""
        mean, wrench = follow(lag, wrench, demand)
        derivative = make_free_derivative(self.physics, self.vehicle.gravity, self.air_w)
        integrate = make_integrator(self.vehicle.integrator, derivative, dt, substeps=1)
        body = integrate(body, scaled(mean, self.gain))
        return body._replace(attitude=quaternion.normalise(body.attitude)), wrench


def track(vehicle: Vehicle, state: DroneState, reference: Reference, agility: Array | float) -> Float[Array, "4 *B"]:
    """The thrust and rates that follow a reference; see `cruise.dynamics.tracking`."""
    airframe = _airframe(vehicle)
    force = demanded_force(vehicle, state, reference, agility)
    thrust, rates = towards(force, rotation(state), reference.heading, vehicle.tracking.attitude_gain)
    turns = [rate / highest for rate, highest in zip(rates, airframe.rates.highest, strict=True)]
    return jnp.clip(jnp.stack([2 * thrust / agility - 1, *turns]), -1.0, 1.0)


def rotation(state: DroneState) -> Float[Array, "3 3 *B"]:
    """R_WB."""
    return quaternion.rotation_matrix(_attitude(state))


def proprioception(airframe: Airframe) -> tuple[Term, ...]:
    """What the drone feels of itself, as vectors in the world's frame."""
    rates = "angular velocity made of roll, pitch and yaw rate, each over the highest that can be asked for"
    return (
        Term("thrust_axis", 3, "the body's z axis: where its thrust points", fn=lambda state: rotation(state)[:, 2]),
        Term("heading_axis", 3, "the body's x axis: where its nose points", fn=lambda state: rotation(state)[:, 0]),
        Term("body_rates", 3, rates, fn=partial(_rates_w, airframe)),
    )


def internal(airframe: Airframe) -> tuple[Term, ...]:
    """The same in its own frame, and the last action."""
    rates = "roll, pitch and yaw rate over the highest that can be asked for"
    return (
        Term("body_rates", 3, rates, frame="body", fn=lambda state: jnp.stack(_rates(airframe, state))),
        Term("previous_action", 4, "the action one control step before", frame="body", fn=_previous_action),
    )


def _rates(airframe: Airframe, state: DroneState) -> list[Array]:
    return [rate / highest for rate, highest in zip(state.angular_velocity_b, airframe.rates.highest, strict=True)]


def _rates_w(airframe: Airframe, state: DroneState) -> Float[Array, "3 *B"]:
    turn, (p, q, r) = rotation(state), _rates(airframe, state)
    return turn[:, 0] * p + turn[:, 1] * q + turn[:, 2] * r


def _previous_action(state: DroneState) -> Float[Array, "4 *B"]:
    return state.memory.commands[0]


def induced_air(airframe: Airframe, state: DroneState, airborne: Bool[Array, "N *B"]) -> Float[Array, "3 N *B"]:
    """Velocity of the air that the rotors of the other drones push down at each drone [m/s]."""
    axis_w = jnp.stack(quaternion.thrust_axis_w(_attitude(state)))
    return induced_air_w(airframe.rotors, state.position_w, axis_w, state.memory.wrench[0], airborne)


def _airframe(vehicle: Vehicle) -> Airframe:
    assert vehicle.airframe is not None
    return vehicle.airframe


def _by_attitude(vehicle: Vehicle) -> bool:
    return vehicle.control == "attitude"


def _attitude(state: DroneState) -> Float[Array, "4 *B"]:
    assert isinstance(state.body, FreeBody)
    return state.body.attitude


def _in_effect(asked: list[Any], delay: Any, elapsed: Any, control_dt: float, dt: float) -> Any:
    return jax.tree.map(lambda *each: in_effect(each, delay, elapsed, control_dt, dt), *asked)


def _air(physics: Physics, air_w: Array | None) -> Any:
    """Wind and what other drones make of the air, component by component; None where it stands still."""
    if physics.wind_w is None or air_w is None:
        moved = physics.wind_w if air_w is None else air_w
        return None if moved is None else tuple(moved)
    return tuple(wind + air for wind, air in zip(physics.wind_w, air_w, strict=True))


def _sag(vehicle: Vehicle, memory: Memory) -> tuple[Array | float, Array | None]:
    """Share of their thrust that the rotors give in this step, and the battery's charge after it."""
    airframe = _airframe(vehicle)
    if airframe.battery is None or memory.charge is None:
        return 1.0, None
    thrusts = rotor_thrusts(airframe.rotors, Wrench(memory.wrench[0], memory.wrench[1:]))
    now = supply(airframe.battery, ideal_power(airframe.rotors, thrusts), memory.charge)
    return now.thrust_share, discharge(airframe.battery, memory.charge, now.current, vehicle.control_dt)


def _above_ground(body: FreeBody) -> FreeBody:
    """The ground stops what sinks into it; whether touching it is a crash is a matter of the rules."""
    x, y, z = body.position_w
    vx, vy, vz = body.velocity_w
    return body._replace(
        position_w=jnp.stack([x, y, jnp.maximum(z, 0.0)]),
        velocity_w=jnp.stack([vx, vy, jnp.where(z <= 0, jnp.maximum(vz, 0.0), vz)]),
    )
