"""Other simulators move our vehicles by the same laws: frames, signs, units and rates are carried over right."""

import functools
import importlib.util
import os
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.config import Rotors
from cruise.dynamics import DroneState, Dynamics, make_dynamics
from cruise.dynamics.rotors import rotor_thrusts, wrench_of
from cruise.errors import CruiseError
from cruise.interop.flight_controller import rotor_commands
from cruise.interop.simulators import SIMULATORS, make_simulated
from cruise.presets import VEHICLES

RACER, CRAZYFLIE = VEHICLES["racer"], VEHICLES["crazyflie"]
THERE = [name for name in SIMULATORS if name != "betaflight" and importlib.util.find_spec(name) is not None]
if os.environ.get("SCIPY_ARRAY_API") != "1":  # without it Crazyflow cannot be imported: see docs/sim-to-sim.md
    THERE = [name for name in THERE if name != "crazyflow"]
DRONES = 3


def hovering(vehicle) -> np.ndarray:
    action = np.zeros((4, DRONES), np.float32)
    action[0] = 2 * vehicle.gravity / vehicle.agility - 1
    return action


@functools.cache
def compiled(name: str, vehicle_name: str) -> tuple[Dynamics, object]:
    vehicle = VEHICLES[vehicle_name]
    dynamics = make_dynamics(vehicle) if name == "cruise" else make_simulated(name, vehicle)
    return dynamics, jax.jit(lambda state, action: dynamics.step(state, action, vehicle.agility))


def fly(name: str, actions: np.ndarray, vehicle=RACER, headings=(0.0, 1.0, -2.0)) -> DroneState:
    """Where drones of those headings are after `actions` [K, 4, DRONES], from hovering at 50 m."""
    dynamics, step = compiled(name, vehicle.name)
    position = jnp.zeros((3, DRONES)).at[2].set(50.0)
    state = dynamics.init(position, jnp.array(headings))
    for action in actions:
        state = step(state, jnp.asarray(action))
    return state


def test_there_is_at_least_one() -> None:
    assert {"mujoco", "rotorpy"} <= set(THERE)


@pytest.mark.parametrize("vehicle", [RACER, CRAZYFLIE], ids=lambda v: v.name)
@pytest.mark.parametrize("name", THERE)
def test_hovers(name: str, vehicle) -> None:
    state = fly(name, np.repeat(hovering(vehicle)[None], 50, axis=0), vehicle)
    np.testing.assert_allclose(state.velocity_w, 0.0, atol=2e-3)
    np.testing.assert_allclose(state.position_w[2], 50.0, atol=2e-3)


@pytest.mark.parametrize("name", THERE)
def test_falls_freely_but_for_drag(name: str) -> None:
    """A second without thrust: g, less a drag that is at most ours along the thrust axis (RotorPy: none at rest)."""
    none = hovering(RACER)
    none[0] = -1.0
    ours, theirs = (fly(one, np.repeat(none[None], 50, axis=0)) for one in ("cruise", name))
    sinking = np.asarray(theirs.velocity_w[2])
    assert (sinking > -9.81).all()
    assert (sinking < np.asarray(ours.velocity_w[2]) + 0.1).all()
    np.testing.assert_allclose(theirs.velocity_w[:2], 0.0, atol=1e-3)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("name", THERE)
def test_body_rates_follow_a_command_as_ours_do(name: str, axis: int) -> None:
    """A step of a rate small enough that no rotor saturates: the same sign, the same response within a tenth."""
    action = hovering(RACER)
    action[1 + axis] = [0.05, -0.05, 0.03]
    for steps in (3, 6, 12):
        ours, theirs = (fly(one, np.repeat(action[None], steps, axis=0)) for one in ("cruise", name))
        wanted, got = (np.asarray(state.angular_velocity_b) for state in (ours, theirs))
        np.testing.assert_allclose(got[axis], wanted[axis], rtol=0.1)
        np.testing.assert_allclose(np.delete(got, axis, 0), 0.0, atol=0.02)


@pytest.mark.parametrize("name", THERE)
def test_a_manoeuvre_ends_where_ours_does(name: str) -> None:
    """Tilt, fly, turn, climb within the rotors' limits: 0.7 s and 3 m, from three headings."""
    parts = ((0.0, 0.04, 0.0), (0.04, 0.0, 0.05), (-0.03, -0.05, 0.05), (0.0, 0.02, -0.04))
    actions = []
    for roll, pitch, yaw in parts:
        action = hovering(RACER)
        action[1:] += np.array([[roll], [pitch], [yaw]], np.float32)
        action[0] += 0.05
        actions += [action] * 9
    ours, theirs = (fly(one, np.array(actions)) for one in ("cruise", name))
    np.testing.assert_allclose(theirs.position_w, ours.position_w, atol=0.08)
    np.testing.assert_allclose(theirs.velocity_w, ours.velocity_w, atol=0.2)
    turn = np.asarray(ours.body.attitude * theirs.body.attitude).sum(axis=0)
    np.testing.assert_allclose(np.abs(turn), 1.0, atol=2e-3)


@pytest.mark.parametrize("control", ["attitude", "velocity"])
def test_whatever_an_action_means_it_means_the_same_there(control: str) -> None:
    """A lean, or a speed, that is held: attitude and velocity as ours after a second."""
    vehicle = replace(RACER, control=control)
    action = {"attitude": [0.2, -0.1, 0.0, 2 * 10.2 / RACER.agility - 1], "velocity": [0.2, -0.1, 0.05]}[control]
    ends = []
    for dynamics in (make_dynamics(vehicle), make_simulated("mujoco", vehicle)):
        state = dynamics.init(jnp.array([[0.0], [0.0], [50.0]]), jnp.array([0.5]))
        step = jax.jit(lambda state, action, fly=dynamics.step: fly(state, action, vehicle.agility))
        for _ in range(50):
            state = step(state, jnp.array(action)[:, None])
        ends.append((np.asarray(dynamics.euler(state)), np.asarray(state.velocity_w)))
    np.testing.assert_allclose(ends[1][0], ends[0][0], atol=0.03)
    np.testing.assert_allclose(ends[1][1], ends[0][1], atol=0.2)
    if control == "attitude":
        np.testing.assert_allclose(ends[0][0][:2, 0], [0.18, -0.09], atol=0.01)


@pytest.mark.parametrize("name", THERE)
def test_rotors_lag_and_their_thrust_is_remembered(name: str) -> None:
    """Full thrust from hovering: after 0.02 s part of the way, after 0.4 s all of it."""
    full = hovering(RACER)
    full[0] = 1.0
    most = 4 * RACER.airframe.rotors.max_thrust
    soon, late = (np.asarray(fly(name, np.repeat(full[None], k, axis=0)).memory.wrench[0]) for k in (1, 20))
    hover = RACER.mass * RACER.gravity
    assert ((soon > hover + 0.3 * (most - hover)) & (soon < hover + 0.6 * (most - hover))).all()
    np.testing.assert_allclose(late, most, rtol=0.02)


def test_the_flight_controller_is_that_of_the_vehicle_within_the_limits() -> None:
    """Its rotors make the wrench m c, J (omega_c - omega) / t + omega x J omega, and no rotor is beyond its limits."""
    rng = np.random.default_rng(0)
    thrust, rates = np.full(5, 9.81), rng.normal(0, 0.5, (3, 5))
    wanted = rates + rng.normal(0, 0.2, (3, 5))
    commands = np.array(rotor_commands(RACER, thrust, wanted, rates))
    wrench = wrench_of(RACER.airframe.rotors, jnp.asarray(commands))
    inertia = np.array(RACER.inertia)[:, None]
    torque = inertia * (wanted - rates) / RACER.airframe.rates.time_constant
    torque += np.cross(rates, inertia * rates, axis=0)
    np.testing.assert_allclose(wrench.collective_thrust, RACER.mass * 9.81, rtol=1e-5)
    np.testing.assert_allclose(wrench.body_torque_b, torque, atol=1e-5)
    hard = np.array(rotor_commands(RACER, 30 + thrust, 50 * wanted, rates))
    rotors: Rotors = RACER.airframe.rotors
    assert hard.min() >= rotors.min_thrust
    assert hard.max() <= rotors.max_thrust
    np.testing.assert_allclose(rotor_thrusts(rotors, wrench), commands, rtol=1e-5)


def test_what_cannot_be_is_one_line(monkeypatch) -> None:
    with pytest.raises(
        CruiseError, match="unknown simulator 'gazebo': there are mujoco, rotorpy, crazyflow, betaflight"
    ):
        make_simulated("gazebo", RACER)
    with pytest.raises(CruiseError, match="fly vehicles by thrust and body rates, and 'paper' is not flown so"):
        make_simulated("mujoco", VEHICLES["paper"])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(CruiseError, match=r"rotorpy is not installed: pip install 'rotorpy>="):
        make_simulated("rotorpy", RACER)
