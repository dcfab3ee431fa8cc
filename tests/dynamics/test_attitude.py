"""Flown by attitude: the loop is the law that it names, and what is commanded is what is held."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cruise.actions import YawControl
from cruise.config import AttitudeLimits, Vehicle
from cruise.dynamics import Reference
from cruise.dynamics.attitude import attitude_loop, heading_of, setpoint
from cruise.dynamics.quadrotor import hovering_action
from tests.dynamics.quadrotors import (
    BARE,
    RACER,
    dynamics_of,
    fly,
    fly_as_given,
    random_attitudes,
    smooth_actions,
    state_of,
    with_airframe,
)
from tests.helpers import assert_trees_close, yaw_matrix

TILT = 0.8


def by_attitude(vehicle: Vehicle, yaw: YawControl = "rate") -> Vehicle:
    return with_airframe(replace(vehicle, control="attitude"), attitude=AttitudeLimits(TILT, yaw))


def action_for(vehicle: Vehicle, roll: float, pitch: float, turn: float, thrust: float) -> np.ndarray:
    """The action that stands for these, by what the vehicle declares of it."""
    numbers = vehicle.action.numbers
    return np.array([one.share(value) for one, value in zip(numbers, (roll, pitch, turn, thrust), strict=True)])


def scipy_attitudes(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.roll(np.asarray(q), -1, axis=0).T)


@pytest.mark.parametrize("yaw", ["rate", "angle"])
def test_the_loop_is_that_of_brescianini_written_again(yaw: YawControl) -> None:
    vehicle = with_airframe(by_attitude(RACER, yaw), rates=replace(RACER.airframe.rates, highest=(1e3, 1e3, 1e3)))
    gain, q = vehicle.tracking.attitude_gain, random_attitudes(200, seed=3)
    actions = np.random.default_rng(4).uniform(-1, 1, (4, 200))
    own = scipy_attitudes(q)
    heading = own.as_euler("ZYX")[:, 0]
    turn = np.pi * actions[2] if yaw == "angle" else heading
    wanted = Rotation.from_euler("ZYX", np.stack([turn, TILT * actions[1], TILT * actions[0]], axis=1))
    left = (own.inv() * wanted).as_quat(canonical=True)
    expected = 2 * gain * left[:, :3]
    if yaw == "rate":
        expected += 1e3 * actions[2][:, None] * own.inv().apply([0, 0, 1])
    with jax.enable_x64(True):
        asked = setpoint(vehicle, jnp.asarray(actions), vehicle.agility)
        got = attitude_loop(vehicle, asked, jnp.asarray(q))
    expected = np.clip(expected, -1e3, 1e3)
    np.testing.assert_allclose(np.stack(got.rates_b).T, expected, atol=1e-6)
    np.testing.assert_allclose(got.thrust, (actions[3] + 1) / 2 * vehicle.agility)


def test_what_is_commanded_is_held() -> None:
    """Roll and pitch, at any heading, and the thrust; and with yaw as a rate the heading turns at that rate."""
    vehicle = by_attitude(BARE)
    start = state_of(vehicle, attitude=(np.cos(0.6), 0, 0, np.sin(0.6)))
    asked = np.array([[0.5, -0.3, 0.0, 12.0], [-0.2, 0.4, 0.0, 8.0], [0.0, 0.0, 1.5, 10.0]])
    actions = np.tile(np.stack([action_for(vehicle, *one) for one in asked], axis=-1), (100, 1, 1))
    flown = fly(vehicle, jax.tree.map(lambda x: jnp.stack([x] * 3, axis=-1), start), actions)
    euler = scipy_attitudes(flown.body.attitude[-1]).as_euler("ZYX")
    np.testing.assert_allclose(euler[:2, 2], asked[:2, 0], atol=1e-3)
    np.testing.assert_allclose(euler[:2, 1], asked[:2, 1], atol=1e-3)
    np.testing.assert_allclose(euler[:2, 0], 1.2, atol=0.03)  # nobody holds it: the way there turns it a little
    np.testing.assert_allclose(flown.memory.wrench[-1][0], BARE.mass * asked[:, 3], rtol=1e-5)
    np.testing.assert_allclose(flown.body.angular_velocity_b[-1][:, 2], [0, 0, 1.5], atol=1e-3)


def test_a_commanded_heading_is_reached_the_short_way() -> None:
    vehicle = by_attitude(BARE, "angle")
    headings = np.array([3.0, -1.0, 0.5])
    start = state_of(vehicle, attitude=np.array([[np.cos(1.4)] * 3, [0] * 3, [0] * 3, [-np.sin(1.4)] * 3]))  # at -2.8
    actions = np.stack([action_for(vehicle, 0.2, 0.1, heading, 9.81) for heading in headings], axis=-1)
    flown = fly(vehicle, start, np.tile(actions, (150, 1, 1)))
    euler = scipy_attitudes(flown.body.attitude[-1]).as_euler("ZYX")
    np.testing.assert_allclose(euler, np.stack([headings, [0.1] * 3, [0.2] * 3], axis=1), atol=1e-3)
    course = np.unwrap(np.stack([heading_of(q) for q in flown.body.attitude]), axis=0)
    turned = np.abs(np.diff(course, axis=0)).sum(axis=0)
    np.testing.assert_allclose(turned, [2 * np.pi - 5.8, 1.8, 2 * np.pi - 3.3], atol=0.15)


@pytest.mark.parametrize("yaw", ["rate", "angle"])
def test_the_hovering_action_hovers(yaw: YawControl) -> None:
    vehicle = by_attitude(RACER, yaw)
    heading = 2.0
    start = dynamics_of(vehicle).init(jnp.array([1.0, 2.0, 3.0]), jnp.asarray(heading))
    action = np.array([float(share) for share in hovering_action(vehicle, heading)])
    np.testing.assert_allclose(start.memory.commands[0], action, atol=1e-6)
    flown = fly(vehicle, start, np.tile(action.astype(np.float32), (100, 1)))
    np.testing.assert_allclose(flown.body.position_w[-1], [1, 2, 3], atol=1e-3)
    np.testing.assert_allclose(heading_of(flown.body.attitude[-1]), heading, atol=1e-4)
    neutral = np.tile(np.float32(vehicle.action.neutral), (100, 1))
    np.testing.assert_allclose(fly(vehicle, start, neutral).body.position_w[-1], [1, 2, 3], atol=0.02)


@pytest.mark.parametrize("yaw", ["rate", "angle"])
def test_there_is_no_north(yaw: YawControl) -> None:
    """A world turned about z: the same actions, but for a commanded heading, make the same flight."""
    vehicle, turn, steps = by_attitude(RACER, yaw), 0.7, 40
    start = state_of(vehicle, velocity=(2.0, -1.0, 0.5))
    actions = (0.4 * smooth_actions(steps, 1)[..., 0]).astype(np.float32)
    half = turn / 2
    turned = state_of(
        vehicle, (np.cos(half), 0, 0, np.sin(half)), velocity=yaw_matrix(turn) @ np.array([2.0, -1.0, 0.5])
    )
    turned_actions = actions.copy()
    if yaw == "angle":
        turned_actions[:, 2] += turn / np.pi
    first, second = fly(vehicle, start, actions), fly(vehicle, turned, turned_actions)
    assert np.abs(np.asarray(first.body.velocity_w)[-1]).max() > 1
    np.testing.assert_allclose(
        second.body.velocity_w, np.asarray(first.body.velocity_w) @ yaw_matrix(turn).T, atol=3e-3
    )
    np.testing.assert_allclose(second.body.angular_velocity_b, first.body.angular_velocity_b, atol=5e-3)


def test_one_drone_is_a_batch_of_drones() -> None:
    vehicle = by_attitude(with_airframe(RACER, delay=0.03, longest_delay=0.04))
    start, actions = state_of(vehicle, random_attitudes(6)), smooth_actions(20, 6).astype(np.float32)
    many = fly_as_given(vehicle, start, actions)
    one = fly_as_given(vehicle, jax.tree.map(lambda x: x[..., 4], start), actions[..., 4])
    assert_trees_close(one, jax.tree.map(lambda x: x[..., 4], many), atol=2e-4)


@pytest.mark.parametrize("yaw", ["rate", "angle"])
def test_a_place_and_a_heading_are_followed(yaw: YawControl) -> None:
    vehicle = by_attitude(RACER, yaw)
    dynamics = dynamics_of(vehicle)
    reference = Reference(position_w=jnp.array([3.0, -2.0, 6.0]), heading=jnp.asarray(-2.5))

    def advance(state, _):
        return dynamics.step(state, dynamics.track(state, reference, vehicle.agility), vehicle.agility), None

    start = dynamics.init(jnp.array([0.0, 0.0, 5.0]), jnp.asarray(2.5))
    end, _ = jax.lax.scan(advance, start, length=250)
    np.testing.assert_allclose(end.position_w, [3, -2, 6], atol=0.02)
    np.testing.assert_allclose(heading_of(end.body.attitude), -2.5, atol=0.02)
    away = dynamics.track(start, Reference(velocity_w=jnp.array([50.0, -50.0, 0.0])), vehicle.agility)
    tilt = np.asarray(away[:2]) * TILT
    assert np.arccos(np.cos(tilt[0]) * np.cos(tilt[1])) == pytest.approx(TILT, abs=1e-3)  # no farther than may be asked
