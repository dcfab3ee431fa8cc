"""The flight controller for simulators that take rotor commands: rate loop and mixer, on NumPy or JAX arrays alike."""

from typing import Any

from cruise.config import Rotors, Vehicle
from cruise.dynamics.quadrotor import Setpoint, rate_loop
from cruise.dynamics.rotors import each_thrust
from cruise.errors import CruiseError


def rotor_commands(vehicle: Vehicle, thrust: Any, wanted_b: Any, rates_b: Any) -> list[Any]:
    """Thrust of each of the four rotors [N], as far as they can give it.

    The law is that of the vehicle (docs/vehicles.md), but a demand beyond the rotors' limits is cut rotor by rotor: who
    gives way to whom is the choice of our own simulator.

    Args:
        vehicle: whose mass, inertia and rotors the controller believes in.
        thrust: collective, per mass [m/s^2], [*B].
        wanted_b: body rates asked for [rad/s], [3, *B].
        rates_b: body rates measured [rad/s], [3, *B].
    """
    rotors, lag = rotors_of(vehicle), vehicle.airframe.rates.time_constant  # type: ignore[union-attr]
    demand = rate_loop(vehicle, lag, Setpoint(thrust, tuple(wanted_b)), rates_b)
    return [one.clip(rotors.min_thrust, rotors.max_thrust) for one in each_thrust(rotors, demand)]


def rotors_of(vehicle: Vehicle) -> Rotors:
    """Raises CruiseError where the vehicle has none."""
    if vehicle.airframe is None or vehicle.control != "ctbr":
        raise CruiseError(
            f"other simulators fly vehicles by thrust and body rates, and {vehicle.name!r} is not flown so"
        )
    return vehicle.airframe.rotors


def hover_thrust(vehicle: Vehicle) -> float:
    """Of one rotor [N]."""
    return vehicle.mass * vehicle.gravity / 4
