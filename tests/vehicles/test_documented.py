"""What the documentation says of vehicles is what is declared, and what is declared is what the equations do."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from cruise.dynamics import make_dynamics
from cruise.dynamics.attitude import setpoint as attitude_setpoint
from cruise.dynamics.cascade import velocity_error
from cruise.dynamics.quadrotor import setpoint
from cruise.dynamics.references import reference_of
from docs.write_vehicle_tables import PAGE, TABLES, flown, written


def test_the_tables_of_the_page_are_those_of_the_declarations():
    page = PAGE.read_text()
    assert written(page) == page
    assert all(table() in page for table in TABLES.values())


def physical(vehicle, action):
    """What an action asks for, by the equations themselves."""
    agility = vehicle.agility
    if vehicle.action.kind == "ctbr":
        asked = setpoint(vehicle.airframe, action, agility)
        return [asked.thrust, *asked.rates_b]
    if vehicle.action.kind == "attitude":
        asked = attitude_setpoint(vehicle, action, agility)
        return [asked.roll, asked.pitch, asked.turn, asked.thrust]
    if vehicle.flown_by == "cascade":
        return list(velocity_error(action, agility, vehicle.control_dt) / vehicle.control_dt)
    state = make_dynamics(vehicle).init(jnp.zeros(3), jnp.zeros(()))
    reference = reference_of(vehicle, state, action, agility)
    (given,) = (part for part in reference if part is not None)
    return list(given)


@pytest.mark.parametrize("vehicle", [vehicle for _, vehicle in flown()], ids=[name for name, _ in flown()])
def test_what_an_action_is_said_to_mean_is_what_it_does(vehicle):
    numbers = vehicle.action.numbers
    assert vehicle.action.size == make_dynamics(vehicle).action_size == len(vehicle.action.neutral)
    for end, limit in ((-1.0, [n.low for n in numbers]), (1.0, [n.high for n in numbers])):
        action = jnp.full(len(numbers), end)
        np.testing.assert_allclose(np.stack(physical(vehicle, action)), limit, rtol=1e-5, atol=1e-6)
    middle = [(n.low + n.high) / 2 for n in numbers]
    np.testing.assert_allclose([n.share(value) for n, value in zip(numbers, middle, strict=True)], 0, atol=1e-12)


def test_an_action_keeps_what_it_means_at_another_agility():
    """A policy has its own: `replace(vehicle, agility=...)` says what its actions mean."""
    vehicle = replace(flown()[0][1], agility=20.0)
    assert vehicle.action.numbers[0].high == 20.0
    assert vehicle.action.neutral[0] == pytest.approx(2 * 9.81 / 20 - 1)
