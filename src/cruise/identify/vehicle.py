"""What was found, as a vehicle file."""

from dataclasses import replace

from cruise.config import Vehicle
from cruise.identify.found import Estimate, Found
from cruise.vehicles.document import to_text

# Place in `Vehicle` of what was found, and of what follows from it.
PLACES = {
    "rotor_lag": "airframe.rotors.time_constant",
    "rate_lag": "airframe.rates.time_constant",
    "delay": "airframe.delay",
    "horizontal_drag": "airframe.drag.horizontal",
    "vertical_drag": "airframe.drag.vertical",
    "torque_ratio": "airframe.rotors.torque_ratio",
    "thrust": "agility",
}
UNITS = {
    "thrust": "m/s^2",
    "curvature": "m/s^2",
    "rotor_lag": "s",
    "rate_lag": "s",
    "delay": "s",
    "drift": "s/s",
    "damping": "1/s",
    "yaw_damping": "1/s",
    "horizontal_drag": "kg/s",
    "vertical_drag": "kg/s",
    "torque_ratio": "m",
}


def identified_vehicle(start: Vehicle, found: Found, name: str, source: str) -> Vehicle:
    """The vehicle to start from with the numbers that were told."""
    airframe = start.airframe
    assert airframe is not None
    told = {key: estimate.value for key, estimate in in_units(start, found).items() if estimate.told}
    rotors = replace(
        airframe.rotors,
        time_constant=told.get("rotor_lag", airframe.rotors.time_constant),
        torque_ratio=abs(told.get("torque_ratio", airframe.rotors.torque_ratio)),
        max_thrust=told["thrust"] * start.mass / 4 if "thrust" in told else airframe.rotors.max_thrust,
    )
    delay = max(told.get("delay", airframe.delay), 0.0)
    flown = replace(
        airframe,
        rotors=rotors,
        rates=replace(airframe.rates, time_constant=told.get("rate_lag", airframe.rates.time_constant)),
        delay=delay,
        longest_delay=max(airframe.longest_delay, delay),
        drag=replace(
            airframe.drag,
            horizontal=told.get("horizontal_drag", airframe.drag.horizontal),
            vertical=told.get("vertical_drag", airframe.drag.vertical),
        ),
    )
    return replace(start, name=name, source=source, agility=told.get("thrust", start.agility), airframe=flown)


def in_units(start: Vehicle, found: Found) -> dict[str, Estimate]:
    """The estimates in the units of a vehicle file: drag not per mass."""
    scales = {"horizontal_drag": start.mass, "vertical_drag": start.mass}
    numbers = {}
    for name, (value, low, high, told) in ((name, vars(one).values()) for name, one in found.numbers.items()):
        scale = scales.get(name, 1.0)
        numbers[name] = Estimate(scale * value, scale * low, scale * high, told)
    return numbers


def identified_text(start: Vehicle, found: Found, name: str, source: str) -> str:
    """The file of that vehicle, with the interval behind every number that was told."""
    comments = {}
    for key, place in PLACES.items():
        estimate = in_units(start, found)[key]
        comments[place] = (
            f"identified: {estimate.low:.4g} to {estimate.high:.4g} ({UNITS[key]}, 95 %)"
            if estimate.told
            else "not identified: as the vehicle to start from"
        )
    comments["airframe.rotors.max_thrust"] = "follows from agility_m_s2 and mass"
    return to_text(identified_vehicle(start, found, name, source), comments)
