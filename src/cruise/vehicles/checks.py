"""What a vehicle's numbers must satisfy, told in one line each."""

import math
from collections.abc import Iterator
from typing import Any, get_args

from cruise.actions import Control, YawControl
from cruise.config import Airframe, Integrator, Vehicle
from cruise.errors import CruiseError


def check_vehicle(vehicle: Vehicle) -> None:
    """Raises CruiseError with the first thing that cannot fly."""
    for fault in vehicle_faults(vehicle):
        raise CruiseError(f"vehicle {vehicle.name!r}: {fault}")


def vehicle_faults(vehicle: Vehicle) -> Iterator[str]:
    """Everything that keeps a vehicle from flying, one line each."""
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
        if vehicle.control in ("ctbr", "attitude"):
            follows = {"ctbr": "thrust and body rates", "attitude": "attitude and thrust"}[vehicle.control]
            yield f"has no airframe that follows {follows}: its control must be acceleration, velocity or position"
    else:
        yield from _airframe_faults(vehicle, vehicle.airframe)


def _airframe_faults(vehicle: Vehicle, airframe: Airframe) -> Iterator[str]:
    rotors, battery, limits = airframe.rotors, airframe.battery, airframe.attitude
    yield from _not_positive(rotors, "torque_ratio", "max_thrust", "radius")
    yield from _not_positive(airframe.rates, "time_constant")
    yield from _negative(rotors, "min_thrust", "time_constant")
    yield from _negative(airframe.rates, "integral_gain")
    if not 0 <= rotors.thrust_curve <= 1:
        yield f"thrust_curve must be from 0 to 1, not {rotors.thrust_curve}"
    yield from _negative(airframe.drag, "horizontal", "vertical", "quadratic")
    yield from _negative(airframe, "delay", "longest_delay")
    for what, numbers in (("rotor offsets", rotors.offset), ("highest rates", airframe.rates.highest)):
        if not 0 < min(numbers) <= max(numbers) < math.inf:
            yield f"{what} must be positive, not {numbers}"
    if rotors.min_thrust >= rotors.max_thrust:
        yield f"min_thrust ({rotors.min_thrust}) must be below max_thrust ({rotors.max_thrust})"
    if not 0 < limits.highest_tilt < math.pi / 2:
        yield f"highest_tilt must be above 0 and below {math.pi / 2:.4f}, not {limits.highest_tilt}"
    if not 0 < limits.highest_yaw <= math.pi:
        yield f"highest_yaw must be above 0 and at most {math.pi:.4f}, not {limits.highest_yaw}"
    if limits.yaw not in get_args(YawControl):
        yield f"yaw must be one of {', '.join(get_args(YawControl))}, not {limits.yaw!r}"
    if vehicle.agility <= vehicle.gravity:
        yield f"agility ({vehicle.agility:g}), the highest thrust per mass, must exceed gravity ({vehicle.gravity:g})"
    if rotors.saturate and 4 * rotors.max_thrust <= vehicle.mass * vehicle.gravity:
        yield (
            f"four rotors of {rotors.max_thrust:g} N at most do not lift its weight of "
            f"{vehicle.mass * vehicle.gravity:.4g} N"
        )
    if battery is not None:
        if battery.empty_voltage > battery.full_voltage:
            yield f"empty_voltage ({battery.empty_voltage}) must not exceed full_voltage ({battery.full_voltage})"
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
