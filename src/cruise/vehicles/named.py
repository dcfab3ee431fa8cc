"""Named vehicles: numbers and where they come from. `docs/vehicles.md` has the equations and the sources in full."""

import difflib
import tomllib
from dataclasses import replace
from pathlib import Path

from cruise.config import Airframe, Battery, Drag, Rates, Rotors, Tracking, Vehicle
from cruise.errors import CruiseError
from cruise.vehicles.document import from_document

GRAVITY = 9.81
SHIPPED = Path(__file__).parent / "shipped"

# The five-inch quadrotor of the Zurich group. Mass and rotor lag: Bauersfeld et al., NeuroBEM, RSS 2021; inertia: the
# data set of that paper; arms, torque ratio and drag: Sun et al., A Comparative Study of Nonlinear MPC and
# Differential-Flatness-Based Control for Quadrotor Agile Flight, T-RO 2022, who give its rotors 8.5 N each.
_FIVE_INCH = Vehicle(
    mass=0.752,
    inertia=(0.0025, 0.0021, 0.0043),
    gravity=GRAVITY,
    control_dt=0.02,
    integrator="midpoint",
    substeps=5,
    control="ctbr",
    flip_ends=False,
    tracking=Tracking(speed=12.0, reach=4.0),
    airframe=Airframe(
        rotors=Rotors(offset=(0.075, 0.1), torque_ratio=0.022, max_thrust=8.5, time_constant=0.033, radius=0.0635),
        rates=Rates(time_constant=0.04, highest=(10.0, 10.0, 3.0)),
        drag=Drag(horizontal=0.27, vertical=0.42),
        longest_delay=0.02,
    ),
)


def with_thrust_to_weight(vehicle: Vehicle, ratio: float, name: str, source: str) -> Vehicle:
    """The same airframe with rotors that lift `ratio` times its weight, all of which an action can command."""
    assert vehicle.airframe is not None
    rotors = replace(vehicle.airframe.rotors, max_thrust=ratio * vehicle.mass * vehicle.gravity / 4)
    airframe = replace(vehicle.airframe, rotors=rotors)
    return replace(vehicle, name=name, airframe=airframe, agility=ratio * vehicle.gravity, source=source)


_FIVE_INCH_SOURCE = (
    "five-inch quadrotor of Bauersfeld et al. 2021 and Sun et al. 2022, thrust set to {} times its weight"
)

# Crazyflie 2.0. Mass, inertia, torque ratio, thrust at full command and drag per rotor speed: Foerster, System
# Identification of the Crazyflie 2.0 Nano Quadrocopter, ETH Zurich 2015; drag taken at the rotor speed of hovering,
# 4 x 1898 rad/s by his maps. Rotor lag: parameter file of RotorPy (Folk et al. 2023).
_ROTOR_SPEEDS = 4 * 1898.0  # [rad/s]
_CRAZYFLIE_MASS, _CRAZYFLIE_THRUST = 0.028, 0.1597
_CRAZYFLIE = Vehicle(
    name="crazyflie",
    mass=_CRAZYFLIE_MASS,
    inertia=(16.571710e-6, 16.655602e-6, 29.261652e-6),
    gravity=GRAVITY,
    control_dt=0.02,
    integrator="midpoint",
    substeps=5,
    collision_distance=0.14,
    collision_aspect=0.5,
    source="Foerster 2015, ETH Zurich; rotor lag from RotorPy's crazyflie",
    control="ctbr",
    agility=4 * _CRAZYFLIE_THRUST / _CRAZYFLIE_MASS,
    flip_ends=False,
    indoors=True,
    tracking=Tracking(attitude_gain=7.0, velocity_gain=3.0, position_gain=1.5, speed=3.0, reach=2.0),
    airframe=Airframe(
        rotors=Rotors(
            offset=(0.0325, 0.0325),
            torque_ratio=0.005964552,
            max_thrust=_CRAZYFLIE_THRUST,
            time_constant=0.072,
            radius=0.0231,
        ),
        rates=Rates(time_constant=0.1, highest=(10.0, 10.0, 3.0)),
        drag=Drag(horizontal=9.1785e-7 * _ROTOR_SPEEDS, vertical=10.311e-7 * _ROTOR_SPEEDS),
        longest_delay=0.02,
        battery=None,
    ),
)

_MEASURED: dict[str, Vehicle] = {
    vehicle.name: vehicle
    for vehicle in (
        Vehicle(),
        with_thrust_to_weight(_FIVE_INCH, 3.3, "racer", _FIVE_INCH_SOURCE.format(3.3)),
        with_thrust_to_weight(_FIVE_INCH, 5.0, "racer-5", _FIVE_INCH_SOURCE.format(5)),
        _CRAZYFLIE,
    )
}


def _of_files() -> dict[str, Vehicle]:
    """The vehicles of the files in `shipped/`, whose comments say where each number is published."""
    texts = [file.read_text(encoding="utf-8") for file in sorted(SHIPPED.glob("*.toml"))]
    vehicles = (from_document(tomllib.loads(text), _MEASURED) for text in texts)
    return {vehicle.name: vehicle for vehicle in vehicles}


VEHICLES: dict[str, Vehicle] = _MEASURED | _of_files()


def find_vehicle(vehicle: str | Vehicle) -> Vehicle:
    """The vehicle itself, or the named one. Raises CruiseError, naming those there are, where there is none."""
    if isinstance(vehicle, Vehicle):
        return vehicle
    if vehicle not in VEHICLES:
        close = difflib.get_close_matches(vehicle, VEHICLES, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise CruiseError(f"unknown vehicle {vehicle!r}: {hint}vehicles: {', '.join(VEHICLES)}")
    return VEHICLES[vehicle]


def reference_to(vehicle: Vehicle) -> str | Vehicle:
    """How stored configurations and pilots say which vehicle: a preset by its name, any other one by its numbers."""
    return vehicle.name if VEHICLES.get(vehicle.name) == vehicle else vehicle


def fly_alike(one: Vehicle, other: Vehicle) -> bool:
    """Whether a pilot made for one vehicle can fly the other: same equations, same numbers in an action."""
    return (one.flown_by, one.action.kind, _names(one)) == (other.flown_by, other.action.kind, _names(other))


def _names(vehicle: Vehicle) -> tuple[str, ...]:
    return tuple(number.name for number in vehicle.action.numbers)


def name_of(vehicle: str | Vehicle) -> str:
    """What messages and logs call it."""
    return vehicle if isinstance(vehicle, str) else vehicle.name


# Batteries that these vehicles fly with: `replace(vehicle.airframe, battery=BATTERIES[...])` lets them sag.
BATTERIES: dict[str, Battery] = {
    "racer": Battery(),  # four cells of 1800 mAh, as racing quadrotors of this size carry
    "crazyflie": Battery(
        capacity=900.0, full_voltage=4.2, empty_voltage=3.3, resistance=0.15, efficiency=0.4
    ),  # one cell of 250 mAh
}
