"""References: what each control mode means, on every vehicle, and what the loops make of it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cruise.config import Control
from cruise.dynamics import DroneState, Reference
from cruise.dynamics.tracking import towards, within_thrust
from cruise.vehicles import VEHICLES
from tests.dynamics.quadrotors import RACER, dynamics_of, random_attitudes, state_of

NAMES = ["paper", "racer", "crazyflie"]
SETTLED = {"paper": 40.0, "crazyflie": 8.0}  # by when a reference is reached [s]


def follow(name: str, reference: Reference, seconds: float, start: DroneState | None = None) -> DroneState:
    """The end of a flight that tracks one reference."""
    vehicle = VEHICLES[name]
    dynamics = dynamics_of(vehicle)
    state = dynamics.init(jnp.array([1.0, 2.0, 5.0]), jnp.zeros(())) if start is None else start

    def advance(state, _):
        action = dynamics.track(state, reference, vehicle.agility)
        return dynamics.step(state, action, vehicle.agility), None

    steps = round(seconds / vehicle.control_dt)
    return jax.jit(lambda s: jax.lax.scan(advance, s, length=steps)[0])(state)


@pytest.mark.parametrize("name", NAMES)
def test_a_position_is_reached_with_its_heading(name: str) -> None:
    target = jnp.array([3.0, 0.5, 6.0])
    heading = jnp.asarray(0.0 if name == "paper" else -2.0)  # the paper's controller cannot turn
    end = follow(name, Reference(position_w=target, heading=heading), SETTLED.get(name, 5.0))
    np.testing.assert_allclose(end.position_w, target, atol=0.05)
    np.testing.assert_allclose(end.velocity_w, 0.0, atol=0.05)
    assert float(dynamics_of(VEHICLES[name]).euler(end)[2]) == pytest.approx(float(heading), abs=0.02)


@pytest.mark.parametrize("name", NAMES)
def test_a_velocity_is_reached(name: str) -> None:
    wanted = jnp.array([2.0, -1.0, 0.5])
    end = follow(name, Reference(velocity_w=wanted), SETTLED.get(name, 4.0))
    np.testing.assert_allclose(end.velocity_w, wanted, atol=0.15)


def test_acceleration_is_that_of_the_reference_once_the_attitude_is_there() -> None:
    """Half a second into a sideways acceleration, drag fed forward."""
    wanted = jnp.array([6.0, 0.0, 1.0])
    ends = [follow("racer", Reference(acceleration_w=wanted), seconds) for seconds in (0.4, 0.5)]
    np.testing.assert_allclose((ends[1].velocity_w - ends[0].velocity_w) / 0.1, wanted, atol=0.35)


def test_a_drone_on_its_back_rights_itself() -> None:
    start = state_of(RACER, attitude=(0.0, 1.0, 0.0, 0.0), position=(0.0, 0.0, 50.0))
    start = jax.tree.map(lambda x: x.astype(jnp.float32), start)
    end = follow("racer", Reference(position_w=jnp.array([0.0, 0.0, 50.0])), 5.0, start)
    assert float(dynamics_of(RACER).rotation(end)[2, 2]) > 0.99
    np.testing.assert_allclose(end.position_w, [0, 0, 50], atol=0.05)


def test_rates_turn_the_thrust_axis_the_short_way() -> None:
    """In the plane of the two, at 2 k sin(angle / 2)."""
    rotation = Rotation.from_quat(random_attitudes(200).T, scalar_first=True).as_matrix()
    force = np.random.default_rng(1).normal(0, 10, (3, 200))
    thrust, rates = towards(jnp.asarray(force), jnp.asarray(rotation.transpose(1, 2, 0)), None, 5.0)
    axis, wanted = rotation[:, :, 2].T, force / np.linalg.norm(force, axis=0)
    turn_w = np.einsum("nij,jn->in", rotation, np.asarray(rates))
    np.testing.assert_allclose((turn_w * axis).sum(axis=0), 0.0, atol=1e-4)
    np.testing.assert_allclose((turn_w * wanted).sum(axis=0), 0.0, atol=1e-4)
    change = np.cross(turn_w.T, axis.T).T  # of the axis
    assert ((change * wanted).sum(axis=0) > 0).all()
    angle = np.arccos((axis * wanted).sum(axis=0))
    np.testing.assert_allclose(np.linalg.norm(turn_w, axis=0), 10 * np.sin(angle / 2), rtol=1e-3)
    np.testing.assert_allclose(thrust, np.maximum((axis * force).sum(axis=0), 0), rtol=1e-4, atol=1e-4)


def test_what_is_wanted_beyond_the_thrust_keeps_its_height_and_its_direction() -> None:
    wanted = jnp.array([[30.0, 0.0, 1.0], [40.0, 2.0, 0.0], [12.0, 50.0, -5.0]])
    got = np.asarray(within_thrust(wanted, 9.81, 32.0))
    assert (np.linalg.norm(got, axis=0) <= 0.95 * 32.0 + 1e-4).all()
    np.testing.assert_allclose(got[:, 0] / got[0, 0], [1.0, 4 / 3, got[2, 0] / got[0, 0]], rtol=1e-5)
    np.testing.assert_allclose(got[2], [12.0, 0.95 * 32.0, 0.2 * 9.81], rtol=1e-5)
    easy = jnp.array([3.0, -2.0, 11.0])
    np.testing.assert_allclose(within_thrust(easy, 9.81, 32.0), easy)


@pytest.mark.parametrize("name", ["paper", "racer"])
@pytest.mark.parametrize("control", ["velocity", "position"])
def test_a_control_mode_is_its_reference(name: str, control: Control) -> None:
    """One step of a vehicle flown by references is `track` and one step of the vehicle itself."""
    vehicle = VEHICLES[name]
    own, flown = dynamics_of(vehicle), dynamics_of(replace(vehicle, control=control))
    state = own.init(jnp.array([[0.0, 1.0], [0.0, 2.0], [4.0, 5.0]]), jnp.zeros(2))
    action = jnp.array([[0.5, -2.0], [-0.2, 0.1], [0.1, 0.3]])
    clipped = jnp.clip(action, -1, 1)
    if control == "velocity":
        reference = Reference(velocity_w=vehicle.tracking.speed * clipped)
    else:
        reference = Reference(position_w=state.position_w + vehicle.tracking.reach * clipped)
    expected = own.step(state, own.track(state, reference, vehicle.agility), vehicle.agility)
    got = flown.step(state, action, vehicle.agility)
    assert (flown.action_size, flown.action_frame) == (3, "world")
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), got, expected)


def test_an_acceleration_reference_is_scaled_by_agility() -> None:
    flown = dynamics_of(replace(RACER, control="acceleration"))
    own = dynamics_of(RACER)
    state = own.init(jnp.array([0.0, 0.0, 4.0]), jnp.zeros(()))
    reference = Reference(acceleration_w=jnp.array([5.0, 0.0, -2.0]))
    expected = own.step(state, own.track(state, reference, 10.0), 10.0)
    got = flown.step(state, jnp.array([0.5, 0.0, -0.2]), 10.0)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), got, expected)


@pytest.mark.parametrize("name", ["paper", "racer"])
@pytest.mark.parametrize("control", ["acceleration", "velocity", "position"])
def test_whatever_its_actions_mean_a_vehicle_follows_a_reference_alike(name: str, control: Control) -> None:
    """`track` of a vehicle flown by references gives the reference that makes it do what it would do anyway."""
    vehicle = VEHICLES[name]
    own, flown = dynamics_of(vehicle), dynamics_of(replace(vehicle, control=control))
    state = own.init(jnp.array([0.0, 0.0, 4.0]), jnp.zeros(()))
    near, slow = jnp.array([0.2, -0.1, 4.1]), jnp.array([0.1, 0.05, -0.1])
    for reference in (
        Reference(position_w=near),
        Reference(velocity_w=slow),
        Reference(position_w=near, velocity_w=slow, acceleration_w=slow),
    ):
        expected = own.step(state, own.track(state, reference, vehicle.agility), vehicle.agility)
        got = flown.step(state, flown.track(state, reference, vehicle.agility), vehicle.agility)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), got, expected)
