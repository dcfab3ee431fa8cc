"""The vehicle with the firmware as its flight controller: rotors, air, battery and body are our simulator's."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from cruise.config import Firmware, Vehicle
from cruise.dynamics import Dynamics, FreeBody
from cruise.dynamics.attitude import Setpoint
from cruise.dynamics.parameters import Parameters
from cruise.dynamics.quadrotor import Flight, FlightController, make_quadrotor
from cruise.dynamics.references import with_control
from cruise.dynamics.rotors import Demand, curved, wrench_of
from cruise.interop.betaflight.configure import configured
from cruise.interop.betaflight.fleet import DT, Fleet
from cruise.interop.betaflight.settings import lines_for
from cruise.interop.betaflight.sticks import StickMap, YawLoop, not_wound
from cruise.interop.flight_controller import airframe_of


class InFlight(NamedTuple):
    """Which flight of the firmware a drone is on, and how far: all that a state knows of it."""

    number: Int[Array, "*B"]  # 0: not begun
    tick: Int[Array, "*B"]  # sub-steps since it began
    yaw: YawLoop


class Link(NamedTuple):
    """Between the sticks that are wanted and the firmware's motors."""

    sticks: StickMap
    fleet: Fleet
    held: int  # sub-steps between two looks of the companion computer

    def demand(
        self, flight: Flight, body: FreeBody, wrench: Demand, asked: Setpoint, memory: InFlight
    ) -> tuple[Demand, InFlight]:
        """What the rotors are on their way to, as the firmware's motors say."""
        rotors, shape = airframe_of(flight.vehicle).rotors, memory.number.shape
        lift = wrench.thrust * flight.gain / flight.physics.mass
        looks = memory.tick % self.held == 0
        yaw = self.sticks.yaw_loop(memory.yaw, asked.rates_b[2], body.angular_velocity_b[2], looks)
        channels = self.sticks.channels(asked._replace(rates_b=(*asked.rates_b[:2], yaw.asked)))
        where = (memory.number, memory.tick)
        rows = (*body.angular_velocity_b, *body.attitude, lift, *channels, *where)
        told = jnp.stack([jnp.broadcast_to(row, shape).astype(jnp.float32).reshape(-1) for row in rows])
        result = jax.ShapeDtypeStruct((5, told.shape[1]), jnp.float32)  # one array each way: each costs time
        number, *motors = jax.pure_callback(self.fleet.advance, result, told).reshape(5, *shape)
        made = wrench_of(rotors, [rotors.max_thrust * motor.clip(0.0, 1.0) for motor in motors])
        linear = Demand(made.collective_thrust, tuple(made.body_torque_b))
        demand = curved(rotors, linear, flight.physics.thrust_curve)
        yaw = self.sticks.wind(yaw, body.angular_velocity_b[2], DT)
        return demand, InFlight(number.astype(jnp.int32), memory.tick + 1, yaw)


def make_firmware_flown(vehicle: Vehicle, firmware: Firmware) -> Dynamics:
    """The vehicle as the firmware flies it, a look at the gyro every millisecond.

    `init` begins a flight; a drone's states are one line, and cannot be flown from twice. Delay, battery, downwash and
    randomisation are as in our own simulator.

    Raises:
        CruiseError: the vehicle has no rotors, or the firmware cannot be had or set so.
    """
    airframe_of(vehicle)
    flown = replace(vehicle, substeps=max(1, round(vehicle.control_dt / DT)))
    settings = configured(lines_for(vehicle, firmware))
    sticks = StickMap.of(vehicle, settings.known)
    fleet = Fleet(settings, sticks.hover(vehicle.gravity), firmware.gyro_noise)
    controller = FlightController(Link(sticks, fleet, flown.substeps).demand, _not_begun)
    return with_control(flown, make_quadrotor(flown, controller))


def _not_begun(vehicle: Vehicle, parameters: Parameters, zero: Array) -> InFlight:
    del vehicle, parameters
    none = jnp.zeros(zero.shape, jnp.int32)
    return InFlight(none, none, not_wound(zero))
