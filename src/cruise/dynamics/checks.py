"""What a vehicle's numbers must satisfy, told in one line each."""

import math
from collections.abc import Iterator
from typing import Any, get_args

from cruise.config import Control, Integrator, Vehicle
from cruise.errors import CruiseError


def check_vehicle(vehicle: Vehicle) -> None:
    """Raises CruiseError with the first thing that cannot fly."""
    for fault in _faults(vehicle):
        raise CruiseError(f"vehicle {vehicle.name!r}: {fault}")


def _faults(vehicle: Vehicle) -> Iterator[str]:
    yield from _not_positive(
        vehicle, "mass", "gravity", "control_dt", "collision_distance", "collision_aspect", "agility"
    )
    for axis, moment in zip("xyz", vehicle.inertia, strict=True):
        if not 0 < moment < math.inf:
            yield f"its moment of inertia about {axis} must be positive, not {moment}"
    if vehicle.substeps < 1:
        yield f"substeps must be 1 or more, not {vehicle.substeps}"
    for name, choices in (("integrator", get_args(Integrator)), ("control", get_args(Control))):
        if getattr(vehicle, name) not in choices:
            yield f"{name} must be one of {', '.join(choices)}, not {getattr(vehicle, name)!r}"
    yield from _not_positive(vehicle.tracking, "position_gain", "velocity_gain", "attitude_gain", "speed", "reach")
    if vehicle.airframe is None:
        if vehicle.control == "ctbr":
            yield (
                "has no airframe that follows thrust and body rates: its control must be acceleration, velocity or "
                "position"
            )
        return
    rotors, battery = vehicle.airframe.rotors, vehicle.airframe.battery
    yield from _not_positive(rotors, "torque_ratio", "max_thrust", "radius")
    yield from _not_positive(vehicle.airframe.rates, "time_constant")
    yield from _negative(rotors, "min_thrust", "time_constant")
    yield from _negative(vehicle.airframe.drag, "horizontal", "vertical", "quadratic")
    yield from _negative(vehicle.airframe, "delay", "longest_delay")
    for what, numbers in (("rotor offsets", rotors.offset), ("highest rates", vehicle.airframe.rates.highest)):
        if not 0 < min(numbers) <= max(numbers) < math.inf:
            yield f"{what} must be positive, not {numbers}"
    if rotors.min_thrust >= rotors.max_thrust:
        yield f"min_thrust ({rotors.min_thrust}) must be below max_thrust ({rotors.max_thrust})"
    if battery is not None:
        yield from _not_positive(battery, "capacity", "full_voltage", "empty_voltage", "efficiency")
        yield from _negative(battery, "resistance")


def _not_positive(part: Any, *names: str) -> Iterator[str]:
    for name in names:
        if not 0 < getattr(part, name) < math.inf:
            yield f"{name} must be positive, not {getattr(part, name)}"


def _negative(part: Any, *names: str) -> Iterator[str]:
    for name in names:
        if not 0 <= getattr(part, name) < math.inf:
            yield f"{name} must be 0 or more, not {getattr(part, name)}"
