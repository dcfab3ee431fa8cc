"""What follows from a vehicle's numbers. Plain Python: no JAX."""

import math
from typing import NamedTuple

from cruise.config import Vehicle


class Figure(NamedTuple):
    """A number that says how a vehicle flies."""

    name: str
    value: str
    unit: str
    meaning: str


def thrust_to_weight(vehicle: Vehicle) -> float:
    """Thrust of all rotors per weight; infinite where nothing limits it."""
    airframe = vehicle.airframe
    if airframe is None or not airframe.rotors.saturate:
        return math.inf
    return 4 * airframe.rotors.max_thrust / (vehicle.mass * vehicle.gravity)


def top_speed(vehicle: Vehicle) -> float:
    """The level speed at which drag takes what thrust leaves beside the weight [m/s]; infinite without drag.

    With the thrust c per mass, at most the agility, level acceleration sqrt(c^2 - g^2) balances drag along the way:
    (d_h v + k v^2) / m. The body leans then, and meets the air with part of its vertical drag; that is left out.
    """
    airframe = vehicle.airframe
    if airframe is None:
        return math.inf
    highest = min(vehicle.agility, thrust_to_weight(vehicle) * vehicle.gravity)
    force = vehicle.mass * math.sqrt(max(highest**2 - vehicle.gravity**2, 0.0))
    linear, quadratic = airframe.drag.horizontal, airframe.drag.quadratic
    if quadratic > 0:
        return (math.sqrt(linear**2 + 4 * quadratic * force) - linear) / (2 * quadratic)
    return force / linear if linear > 0 else math.inf


def figures(vehicle: Vehicle) -> list[Figure]:
    """What `cruise vehicles show` says beside the numbers themselves."""
    airframe, weight = vehicle.airframe, vehicle.mass * vehicle.gravity
    found = [Figure("weight", f"{weight:.4g}", "N", "")]
    if airframe is None:
        return found
    response = airframe.rotors.time_constant + airframe.rates.time_constant
    return [
        *found,
        Figure("thrust to weight", _shown(thrust_to_weight(vehicle)), "", "of all rotors at their limit"),
        Figure("hover thrust", f"{weight / 4:.4g}", "N", "of one rotor"),
        Figure("hover share", _shown(100 / thrust_to_weight(vehicle)), "%", "of the highest thrust"),
        Figure("top speed", _shown(top_speed(vehicle)), "m/s", "level, where drag takes all that thrust leaves"),
        Figure("rate response", f"{1000 * response:.3g}", "ms", "time constants of rotors and rate loop together"),
    ]


def _shown(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "unlimited"
