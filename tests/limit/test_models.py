"""The optimiser's equations against those of the simulator, at states drawn at random."""

from dataclasses import replace

import casadi as ca
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Drag
from cruise.dynamics.parameters import AS_BUILT, physics_of
from cruise.dynamics.rigid_body import Wrench, make_free_derivative
from cruise.dynamics.rotors import wrench_of
from cruise.dynamics.types import FreeBody
from cruise.limit.models import make_model, point_mass
from cruise.limit.transcription import shooting
from cruise.presets import VEHICLES

RNG = np.random.default_rng(0)
FLOWN = ("racer", "racer-5", "crazyflie")


def derivative(model, x, u):
    """x' as numbers."""
    symbols = ca.SX.sym("x", model.state_size), ca.SX.sym("u", len(model.control[0]))
    return np.array(ca.Function("f", symbols, [model.derivative(*symbols)])(x, u)).ravel()


def random_body(rates=3.0):
    """Position, velocity, unit quaternion and rates."""
    q = RNG.normal(size=4)
    return RNG.normal(size=3), 8 * RNG.normal(size=3), q / np.linalg.norm(q), rates * RNG.normal(size=3)


def simulators(vehicle, body, wrench):
    """The same derivative by the simulator, in its order."""
    function = make_free_derivative(physics_of(vehicle, AS_BUILT), vehicle.gravity, None)
    parts = function(FreeBody(*(tuple(jnp.float32(x) for x in part) for part in body)), wrench)
    return [np.array([float(x) for x in part]) for part in parts]


@pytest.mark.parametrize("quadratic", [0.0, 0.02])
@pytest.mark.parametrize("name", FLOWN)
def test_a_body_with_four_rotors_is_the_simulators(name, quadratic):
    vehicle = VEHICLES[name]
    drag = replace(vehicle.airframe.drag, quadratic=quadratic * vehicle.mass)
    vehicle = replace(vehicle, airframe=replace(vehicle.airframe, drag=drag))
    model, rotors = make_model(vehicle), vehicle.airframe.rotors
    for _ in range(20):
        body, thrusts, asked = random_body(), *RNG.uniform(0, rotors.max_thrust, (2, 4))
        found = derivative(model, np.concatenate([*body, thrusts]), asked)
        wrench = wrench_of(rotors, jnp.asarray(thrusts, jnp.float32)[:, None])
        wrench = Wrench(wrench.collective_thrust[0], tuple(wrench.body_torque_b[:, 0]))
        expected = np.concatenate([*simulators(vehicle, body, wrench), (asked - thrusts) / rotors.time_constant])
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)


def test_a_body_whose_rates_follow_is_the_simulators():
    vehicle = VEHICLES["racer"]
    vehicle = replace(
        vehicle, airframe=replace(vehicle.airframe, rotors=replace(vehicle.airframe.rotors, saturate=False))
    )
    model = make_model(vehicle)
    for _ in range(20):
        p, v, q, rates = random_body()
        thrust, asked = RNG.uniform(0, vehicle.agility, 2)
        wanted = 3 * RNG.normal(size=3)
        found = derivative(model, np.concatenate([p, v, q, rates, [thrust]]), np.concatenate([[asked], wanted]))
        wrench = Wrench(jnp.float32(vehicle.mass * thrust), (jnp.float32(0),) * 3)
        expected = np.concatenate(simulators(vehicle, (p, v, q, rates), wrench)[:3])
        np.testing.assert_allclose(found[:10], expected, rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(found[10:13], (wanted - rates) / 0.04, rtol=1e-6)
        assert found[13] == pytest.approx((asked - thrust) / 0.033)


@pytest.mark.parametrize("name", FLOWN)
def test_hovering_is_at_rest_and_within_every_bound(name):
    model = make_model(VEHICLES[name])
    np.testing.assert_allclose(derivative(model, model.hover, model.lift), 0, atol=1e-9)
    assert (model.control[0] <= model.lift).all()
    assert (model.lift <= model.control[1]).all()
    assert (model.state[0] <= model.hover).all()
    assert (model.hover <= model.state[1]).all()
    symbols = ca.SX.sym("x", model.state_size), ca.SX.sym("u", 4)
    path = ca.Function("c", symbols, [model.path(*symbols)])(model.hover, model.lift)
    np.testing.assert_allclose(np.array(path), 0, atol=1e-9)


def test_a_torque_beyond_what_a_rate_command_can_ask_for_is_out_of_bounds():
    """Spinning at the highest rate already, no more roll may be commanded; against it, more may."""
    vehicle = VEHICLES["racer"]
    model = make_model(vehicle)
    state = model.hover.copy()
    state[10] = vehicle.airframe.rates.highest[0]
    roll = np.array([1.0, -1.0, -1.0, 1.0])
    symbols = ca.SX.sym("x", model.state_size), ca.SX.sym("u", 4)
    path = ca.Function("c", symbols, [model.path(*symbols)])
    commanded = [float(path(state, model.lift + change * roll)[0]) for change in (-0.1, 0.0, 0.1)]
    assert commanded[1] == pytest.approx(1.0)
    assert commanded[0] < 0.99
    assert commanded[2] > 1.01


def test_a_point_mass_falls_and_its_step_is_of_fourth_order():
    model = point_mass(20.0, 9.81, drag=0.5)
    x, u = np.array([0, 0, 0, 1.0, 2, 3]), np.zeros(3)
    np.testing.assert_allclose(derivative(model, x, u), [1, 2, 3, -0.5, -1, -9.81 - 1.5])
    exact = np.array([1, 2, 3 + 9.81 / 0.5]) * np.exp(-0.5) - np.array([0, 0, 9.81 / 0.5])
    step = shooting(model)

    def error(steps):
        end = x
        for _ in range(steps):
            end = step(end, u, 1 / steps)
        return np.abs(np.array(end).ravel()[3:] - exact).max()

    assert error(4) / error(8) == pytest.approx(16, rel=0.15)


def test_drag_off_is_no_drag():
    vehicle = VEHICLES["racer"]
    without = make_model(replace(vehicle, airframe=replace(vehicle.airframe, drag=Drag())))
    state = without.hover.copy()
    state[3] = 10.0
    assert derivative(without, state, without.lift)[3] == 0
    assert derivative(make_model(vehicle), state, without.lift)[3] == pytest.approx(-10 * 0.27 / 0.752)
