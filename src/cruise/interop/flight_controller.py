"""The flight controller for simulators that take rotor commands: rate loop and mixer, on NumPy or JAX arrays alike."""

from typing import Any

from cruise.config import Airframe, Rotors, Vehicle
from cruise.dynamics.attitude import Setpoint
from cruise.dynamics.quadrotor import rate_loop
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
    rotors, lag = rotors_of(vehicle), airframe_of(vehicle).rates.time_constant
    demand = rate_loop(vehicle, lag, Setpoint(thrust, tuple(wanted_b)), rates_b)
    return [one.clip(rotors.min_thrust, rotors.max_thrust) for one in each_thrust(rotors, demand)]


def rotors_of(vehicle: Vehicle) -> Rotors:
    """Raises CruiseError where the vehicle has none."""
    return airframe_of(vehicle).rotors


def airframe_of(vehicle: Vehicle) -> Airframe:
    """Raises CruiseError where the vehicle has none: other simulators have no law of the paper's."""
    airframe = vehicle.airframe
    if not isinstance(airframe, Airframe):
        raise CruiseError(
            f"other simulators fly vehicles by thrust and body rates, and {vehicle.name!r} is not flown so"
        )
    return airframe


def hover_thrust(vehicle: Vehicle) -> float:
    """Of one rotor [N]."""
    return vehicle.mass * vehicle.gravity / 4
