"""Vehicles that cannot fly are refused in one line."""

import copy
from dataclasses import replace

import pytest

from cruise.config import Battery, Drag, Rates, Vehicle
from cruise.dynamics import make_dynamics
from cruise.errors import CruiseError
from cruise.vehicles import VEHICLES
from tests.dynamics.quadrotors import RACER, with_airframe, with_rotors

PAPER = VEHICLES["paper"]


def untyped(**fields: str) -> Vehicle:
    """A racer with fields that the tests' own checks of types would not let pass."""
    vehicle = copy.copy(RACER)
    for name, value in fields.items():
        object.__setattr__(vehicle, name, value)
    return vehicle


BAD = {
    "no mass": (replace(RACER, mass=0.0), "vehicle 'racer': mass must be positive, not 0.0"),
    "mass nan": (replace(PAPER, mass=float("nan")), "vehicle 'paper': mass must be positive, not nan"),
    "inertia": (replace(PAPER, inertia=(1.0, -1.0, 1.0)), "its moment of inertia about y must be positive, not -1.0"),
    "no steps": (replace(RACER, substeps=0), "substeps must be 1 or more, not 0"),
    "integrator": (untyped(integrator="rk5"), "integrator must be one of euler, semi_implicit, midpoint, rk4"),
    "control": (untyped(control="jerk"), "control must be one of acceleration, velocity, position, ctbr"),
    "rates on paper": (replace(PAPER, control="ctbr"), "vehicle 'paper': has no airframe that follows thrust and body"),
    "rate loop": (with_airframe(RACER, rates=Rates(time_constant=0.0)), "time_constant must be positive, not 0.0"),
    "rotor lag": (with_rotors(RACER, time_constant=-0.1), "time_constant must be 0 or more, not -0.1"),
    "weak rotors": (with_rotors(RACER, min_thrust=9.0), "min_thrust (9.0) must be below max_thrust"),
    "flat": (with_rotors(RACER, offset=(0.1, 0.0)), "rotor offsets must be positive, not (0.1, 0.0)"),
    "push": (with_airframe(RACER, drag=Drag(quadratic=-1.0)), "quadratic must be 0 or more, not -1.0"),
    "foresight": (with_airframe(RACER, delay=-0.01), "delay must be 0 or more, not -0.01"),
    "battery": (with_airframe(RACER, battery=Battery(capacity=0.0)), "capacity must be positive, not 0.0"),
}


@pytest.mark.parametrize("case", BAD)
def test_refused(case: str) -> None:
    vehicle, message = BAD[case]
    with pytest.raises(CruiseError) as error:
        make_dynamics(vehicle)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", VEHICLES)
def test_what_is_named_flies(name: str) -> None:
    assert make_dynamics(VEHICLES[name]).control_dt == VEHICLES[name].control_dt
