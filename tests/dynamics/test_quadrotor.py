"""Laws of the whole quadrotor: what each term does, alone and together with the others."""

from collections.abc import Iterator
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from cruise.config import Rates
from cruise.dynamics import DroneState, Parameters
from cruise.dynamics.rigid_body import Wrench
from cruise.dynamics.rotors import rotor_thrusts
from cruise.vehicles import VEHICLES
from tests.dynamics.quadrotors import (
    BARE,
    RACER,
    action_for,
    dynamics_of,
    fly,
    fly_as_given,
    random_attitudes,
    smooth_actions,
    state_of,
    with_airframe,
    with_drag,
    with_rotors,
)
from tests.helpers import assert_trees_close

AGILE = ["racer", "crazyflie"]  # racer-5 differs from racer in two numbers
WEIGHT = RACER.mass * RACER.gravity
DT = RACER.control_dt


@pytest.fixture(autouse=True)
def float64() -> Iterator[None]:
    with jax.enable_x64(True):
        yield


def repeated(action: np.ndarray, steps: int) -> np.ndarray:
    return np.broadcast_to(action, (steps, *action.shape))


def energy(vehicle, states: DroneState) -> np.ndarray:
    """Of motion and height at every instant of a flight [J]."""
    velocity, rates = np.asarray(states.body.velocity_w), np.asarray(states.body.angular_velocity_b)
    spin = np.einsum("i,ti...->t...", np.array(vehicle.inertia), rates**2)
    height = np.asarray(states.body.position_w)[:, 2]
    return vehicle.mass * (np.sum(velocity**2, axis=1) / 2 + vehicle.gravity * height) + spin / 2


@pytest.mark.parametrize("name", AGILE)
def test_hovering_is_an_equilibrium(name: str) -> None:
    vehicle = VEHICLES[name]
    start = dynamics_of(vehicle).init(jnp.array([1.0, 2.0, 3.0]), jnp.asarray(0.7))
    states = fly(vehicle, start, repeated(action_for(vehicle, vehicle.mass * vehicle.gravity), 50))
    for now, then in zip(states.body, start.body, strict=True):
        np.testing.assert_allclose(now, np.broadcast_to(then, now.shape), atol=1e-9)


def test_rates_follow_as_a_first_order_lag() -> None:
    """Without rotor lag and limits: omega = omega_c (1 - exp(-t / tau)), for a loop that looks every sub-step."""
    wanted = np.array([3.0, -2.0, 1.0])
    flown = np.asarray(fly(BARE, state_of(BARE), repeated(action_for(BARE, WEIGHT, tuple(wanted)), 10)).body[3])
    t = DT * np.arange(1, 11)[:, None]
    np.testing.assert_allclose(flown, wanted * (1 - np.exp(-t / 0.04)), atol=0.06 * 3)  # 4 ms of 40 ms
    quick = replace(BARE, substeps=100)
    flown = np.asarray(fly(quick, state_of(quick), repeated(action_for(quick, WEIGHT, tuple(wanted)), 10)).body[3])
    np.testing.assert_allclose(flown, wanted * (1 - np.exp(-t / 0.04)), atol=0.003 * 3)


def test_the_integral_of_the_rate_loop_is_a_pi_controllers() -> None:
    """omega / omega_c = (s + k) / (t s^2 + s + k), without rotor lag and limits; what has wound up is bounded."""
    k, t, wanted = 12.0, 0.04, np.array([1.0, -0.7, 0.4])
    vehicle = with_airframe(replace(BARE, substeps=100), rates=Rates(time_constant=t, integral_gain=k))
    start = dynamics_of(vehicle).init(jnp.array([0.0, 0.0, 50.0]), jnp.asarray(0.0))
    states = fly(vehicle, start, repeated(action_for(vehicle, WEIGHT, tuple(wanted)), 20))
    times = DT * np.arange(1, 21)
    _, response = signal.step(([1, k], [t, 1, k]), T=np.concatenate([[0.0], times]))
    np.testing.assert_allclose(np.asarray(states.body[3]), wanted * response[1:, None], atol=0.01)
    weak = with_rotors(with_airframe(RACER, rates=Rates(integral_gain=500.0)), max_thrust=3.0)
    start = dynamics_of(weak).init(jnp.array([0.0, 0.0, 50.0]), jnp.asarray(0.0))
    wound = fly(weak, start, repeated(action_for(weak, WEIGHT, (9.0, -9.0, 3.0)), 5)).memory.controller
    most = [2 * lever * 3.0 for lever in (0.1, 0.075, 0.022)]
    assert all(np.abs(np.asarray(one)).max() <= limit * (1 + 1e-9) for one, limit in zip(wound, most, strict=True))
    assert np.isclose(np.abs(np.asarray(wound[2])).max(), most[2])


@pytest.mark.parametrize("name", AGILE)
def test_rates_and_thrust_come_to_what_is_commanded(name: str) -> None:
    """The gyroscopic torque is compensated, the lags end: steady states are exact."""
    vehicle = VEHICLES[name]
    wanted, thrust = (1.0, -0.5, 0.4), 1.1 * vehicle.mass * vehicle.gravity
    end = jax.tree.map(
        lambda x: x[-1], fly(vehicle, state_of(vehicle), repeated(action_for(vehicle, thrust, wanted), 100))
    )
    np.testing.assert_allclose(end.body.angular_velocity_b, wanted, rtol=1e-5)
    np.testing.assert_allclose(end.memory.wrench[0], thrust, rtol=1e-9)


def test_thrust_lags_as_its_time_constant_says() -> None:
    vehicle = with_rotors(BARE, time_constant=0.033)
    states = fly(vehicle, state_of(vehicle), repeated(action_for(vehicle, 1.5 * WEIGHT), 10))
    t = DT * np.arange(1, 11)
    np.testing.assert_allclose(states.memory.wrench[:, 0], WEIGHT * (1.5 - 0.5 * np.exp(-t / 0.033)), rtol=1e-9)


def test_single_rotor_limits_bind() -> None:
    """Full thrust, roll and pitch at once: no rotor leaves its limits, so thrust gives way while the rates build up."""
    rotors = RACER.airframe.rotors
    action = action_for(RACER, 4 * rotors.max_thrust, (10.0, 10.0, 0.0))
    flown = {}
    for vehicle in (RACER, with_rotors(RACER, saturate=False)):
        wrench = fly(vehicle, state_of(vehicle), repeated(action, 10)).memory.wrench.T
        flown[vehicle] = np.asarray(rotor_thrusts(rotors, Wrench(jnp.asarray(wrench[0]), jnp.asarray(wrench[1:]))))
    bound, free = flown.values()
    assert bound.min() >= -1e-9
    assert bound.max() <= rotors.max_thrust + 1e-9
    assert free.max() > 1.15 * rotors.max_thrust
    assert bound.sum(axis=0)[1] < 0.9 * free.sum(axis=0)[1]


@pytest.mark.parametrize(
    "drag", [{"horizontal": 0.3, "vertical": 0.5}, {"quadratic": 0.02}, {"vertical": 0.4, "quadratic": 0.01}]
)
def test_a_falling_drone_comes_to_its_terminal_velocity(drag: dict[str, float]) -> None:
    """Level, rotors stopped: m g = d_v v + k v^2."""
    vehicle = with_drag(BARE, **drag)
    states = fly(vehicle, state_of(vehicle, thrust=0.0, position=(0, 0, 1e4)), repeated(action_for(vehicle, 0.0), 1500))
    d, k = drag.get("vertical", 0.0), drag.get("quadratic", 0.0)
    terminal = WEIGHT / d if k == 0 else (np.sqrt(d * d + 4 * k * WEIGHT) - d) / (2 * k)
    np.testing.assert_allclose(states.body.velocity_w[-1], [0, 0, -terminal], rtol=1e-4)


def test_without_drag_a_drone_falls_freely_whatever_its_motion() -> None:
    start = state_of(BARE, random_attitudes(1)[:, 0], (3.0, 2.0, -1.0), (5.0, -1.0, 2.0), thrust=0.0)
    states = fly(BARE, start, repeated(action_for(BARE, 0.0, (3.0, 2.0, -1.0)), 50))
    t = DT * np.arange(1, 51)[:, None]
    gravity = np.array([0, 0, -BARE.gravity])
    np.testing.assert_allclose(states.body.velocity_w, np.array([5, -1, 2]) + gravity * t, atol=1e-9)
    np.testing.assert_allclose(
        states.body.position_w, [0, 0, 100] + np.array([5, -1, 2]) * t + gravity * t**2 / 2, atol=1e-9
    )


def test_drag_always_takes_energy() -> None:
    vehicle = with_drag(BARE, horizontal=0.3, vertical=0.5, quadratic=0.02)
    start = state_of(vehicle, random_attitudes(10), np.zeros((3, 10)), 8.0 * random_attitudes(10, 1)[:3], thrust=0.0)
    states = fly(vehicle, start, np.broadcast_to(action_for(vehicle, 0.0)[:, None], (20, 4, 10)))
    assert (np.diff(energy(vehicle, states), axis=0) < 0).all()


def test_thrust_does_the_work_that_energy_gains() -> None:
    """d/dt E = T b . v without drag and rotation, by Simpson's rule over a flight with held thrust."""
    q = random_attitudes(1, seed=5)[:, 0]
    start = state_of(BARE, q, velocity=(3.0, 1.0, -2.0), thrust=9.0)
    states = fly(BARE, start, repeated(action_for(BARE, 9.0), 40))
    axis = Rotation.from_quat(q, scalar_first=True).as_matrix()[:, 2]
    velocity = np.concatenate([np.array([[3.0, 1.0, -2.0]]), states.body.velocity_w])
    weights = np.array([1, *([4, 2] * 19), 4, 1]) * DT / 3
    gained = energy(BARE, states)[-1] - (BARE.mass * (14 / 2 + BARE.gravity * 100))
    np.testing.assert_allclose(gained, weights @ (9.0 * velocity @ axis), rtol=1e-9)


@pytest.mark.parametrize("steps_late", [1, 2])
def test_delay_is_a_shift(steps_late: int) -> None:
    """A flight delayed by whole control steps is the flight of actions given so much later, hovering before."""
    actions = smooth_actions(30, 3)
    late = with_airframe(RACER, delay=steps_late * DT)
    hover = np.broadcast_to(action_for(RACER, WEIGHT)[:, None], (steps_late, 4, 3))
    start = {v: state_of(v, position=np.full((3, 3), 100.0)) for v in (RACER, late)}
    expected = fly(RACER, start[RACER], np.concatenate([hover, actions[:-steps_late]]))
    assert_trees_close(fly(late, start[late], actions).body, expected.body, atol=1e-9)


def test_delay_by_a_part_of_a_step_shifts_by_sub_steps() -> None:
    """5 ms late at 50 Hz is a flight at 200 Hz in which every action begins one step of four late."""
    part = replace(with_airframe(RACER, delay=DT / 4, longest_delay=DT), substeps=4)
    fine = replace(with_airframe(RACER, longest_delay=0.0), control_dt=DT / 4, substeps=1)
    actions = smooth_actions(20, 2)
    held = np.repeat(actions, 4, axis=0)
    hover = np.broadcast_to(action_for(RACER, WEIGHT)[:, None], (1, 4, 2))
    starts = [state_of(v, position=np.full((3, 2), 100.0)) for v in (part, fine)]
    expected = fly(fine, starts[1], np.concatenate([hover, held[:-1]])).body
    assert_trees_close(fly(part, starts[0], actions).body, jax.tree.map(lambda x: x[3::4], expected), atol=1e-9)


def test_the_quaternion_keeps_its_length() -> None:
    actions = np.random.default_rng(0).choice([-1.0, 1.0], (200, 4, 10))
    attitude = np.asarray(fly(RACER, state_of(RACER, random_attitudes(10)), actions).body.attitude)
    np.testing.assert_allclose(np.linalg.norm(attitude, axis=1), 1.0, atol=1e-12)
    assert np.abs(np.diff(attitude, axis=0)).max() > 0.05


def test_sub_steps_have_converged() -> None:
    """Five sub-steps against forty over one second of hard flight: centimetres and hundredths of a radian."""
    actions = smooth_actions(50, 8)
    ends = []
    for substeps in (5, 10, 40):
        vehicle = replace(RACER, substeps=substeps)
        ends.append(
            jax.tree.map(
                lambda x: np.asarray(x)[-1],
                fly(vehicle, state_of(vehicle, position=np.full((3, 8), 100.0)), actions).body,
            )
        )
    coarse, middle, fine = ends
    assert np.abs(fine.angular_velocity_b).max() > 2
    assert np.abs(coarse.position_w - fine.position_w).max() < 0.1
    for name in ("position_w", "velocity_w", "attitude", "angular_velocity_b"):
        error = [np.abs(getattr(end, name) - getattr(fine, name)).max() for end in (coarse, middle)]
        assert error[1] < 0.6 * error[0], name


MIRROR = np.array([1.0, -1.0, 1.0])[:, None]


def test_mirror_symmetry() -> None:
    """Seen in a mirror in the x-z plane: roll and yaw the other way round, the same flight mirrored."""
    actions = smooth_actions(40, 6)
    rates, velocity = np.random.default_rng(1).normal(0, 3, (2, 3, 6))
    attitude = random_attitudes(6)
    flown = fly(RACER, state_of(RACER, attitude, rates, velocity), actions).body
    turned = np.array([1.0, -1.0, 1.0, -1.0])  # of quaternions, and of (thrust, roll, pitch, yaw)
    there = state_of(RACER, attitude * turned[:, None], -rates * MIRROR, velocity * MIRROR)
    mirrored = fly(RACER, there, actions * turned[:, None]).body
    np.testing.assert_allclose(mirrored.position_w, flown.position_w * MIRROR, atol=1e-9)
    np.testing.assert_allclose(mirrored.velocity_w, flown.velocity_w * MIRROR, atol=1e-9)
    np.testing.assert_allclose(mirrored.attitude, flown.attitude * turned[:, None], atol=1e-9)
    np.testing.assert_allclose(mirrored.angular_velocity_b, -flown.angular_velocity_b * MIRROR, atol=1e-9)


def test_the_quadrotor_knows_no_north() -> None:
    """The world turned about z: the same flight, turned."""
    actions, attitude = smooth_actions(40, 6), random_attitudes(6)
    rates, velocity = np.random.default_rng(1).normal(0, 3, (2, 3, 6))
    turn = Rotation.from_euler("Z", 1.1)
    matrix = turn.as_matrix()
    turned = (turn * Rotation.from_quat(attitude.T, scalar_first=True)).as_quat(scalar_first=True).T
    flown = fly(RACER, state_of(RACER, attitude, rates, velocity), actions).body
    there = fly(RACER, state_of(RACER, turned, rates, matrix @ velocity), actions).body
    np.testing.assert_allclose(there.position_w, np.einsum("ij,tjn->tin", matrix, flown.position_w), atol=1e-9)
    np.testing.assert_allclose(there.velocity_w, np.einsum("ij,tjn->tin", matrix, flown.velocity_w), atol=1e-9)
    np.testing.assert_allclose(there.angular_velocity_b, flown.angular_velocity_b, atol=1e-9)


def test_one_drone_is_a_batch_of_drones() -> None:
    """B = (), (N,) and (N, E) give the same drones."""
    actions, start = smooth_actions(10, 6), state_of(RACER, random_attitudes(6), position=np.full((3, 6), 50.0))
    many = fly_as_given(RACER, start, actions)
    grid_start = jax.tree.map(lambda x: x.reshape(*x.shape[:-1], 2, 3), start)
    grid = fly_as_given(RACER, grid_start, actions.reshape(10, 4, 2, 3))
    assert_trees_close(jax.tree.map(lambda x: x.reshape(*x.shape[:-2], 6), grid), many, atol=1e-10)
    one = fly_as_given(RACER, jax.tree.map(lambda x: x[..., 4], start), actions[:, :, 4])
    assert_trees_close(one, jax.tree.map(lambda x: x[..., 4], many), atol=1e-10)


CHANGED = {
    "mass": 0.9,
    "inertia": (0.003, 0.0025, 0.005),
    "thrust_gain": 0.85,
    "horizontal_drag": 0.5,
    "vertical_drag": 0.2,
    "quadratic_drag": 0.03,
    "rotor_lag": 0.05,
    "rate_lag": 0.06,
    "delay": 0.012,
    "wind_w": (2.0, -1.0, 0.5),
    "min_thrust": 0.4,
    "thrust_curve": 0.3,
    "integral_gain": 10.0,
}


def with_parameters(state: DroneState, drones: int, **parameters: float | tuple) -> DroneState:
    """The first drones as built, the last one with other parameters."""
    nominal = {
        "mass": RACER.mass,
        "inertia": RACER.inertia,
        "thrust_gain": 1.0,
        "horizontal_drag": 0.27,
        "vertical_drag": 0.42,
        "quadratic_drag": 0.0,
        "rotor_lag": 0.033,
        "rate_lag": 0.04,
        "delay": 0.0,
        "wind_w": (0.0, 0.0, 0.0),
        "min_thrust": 0.0,
        "thrust_curve": 0.0,
        "integral_gain": 0.0,
    }
    columns = {}
    for name, value in parameters.items():
        rows = np.stack([np.asarray(nominal[name], float)] * (drones - 1) + [np.asarray(value, float)], axis=-1)
        columns[name] = jnp.asarray(rows)
    return state._replace(parameters=Parameters(**columns))


@pytest.fixture(scope="module")
def as_built() -> tuple[DroneState, np.ndarray, DroneState]:
    with jax.enable_x64(True):
        start = state_of(RACER, random_attitudes(2), velocity=np.full((3, 2), 3.0), position=np.full((3, 2), 50.0))
        start = jax.tree.map(lambda x: jnp.broadcast_to(x[..., :1], x.shape), start)
        start = start._replace(memory=start.memory._replace(controller=(jnp.zeros(2),) * 3))  # of an integral
        actions = np.repeat(smooth_actions(25, 1), 2, axis=2)
        return start, actions, fly(RACER, start, actions)


def test_every_parameter_may_differ_from_drone_to_drone(as_built) -> None:
    """All of them at once: the first drone flies as it was built, the second otherwise; both keep their parameters."""
    start, actions, built = as_built
    flown = fly(RACER, with_parameters(start, 2, **CHANGED), actions)
    for now, then in zip(flown.body, built.body, strict=True):
        np.testing.assert_allclose(now[..., 0], then[..., 0], atol=1e-9)
    assert np.abs(np.asarray(flown.body.position_w - built.body.position_w))[-1, :, 1].max() > 0.1
    np.testing.assert_array_equal(flown.parameters.mass[-1], [RACER.mass, 0.9])


def test_parameters_are_those_of_another_vehicle(as_built) -> None:
    """Drag, lags, delay and what the rate loop and the motors are like as parameters are those of the vehicle."""
    start, actions, _ = as_built
    names = set(CHANGED) - {"mass", "inertia", "thrust_gain", "wind_w"}
    flown = fly(RACER, with_parameters(start, 2, **{name: CHANGED[name] for name in names}), actions)
    rotors = {"time_constant": 0.05, "min_thrust": 0.4, "thrust_curve": 0.3}
    other = with_drag(with_rotors(RACER, **rotors), horizontal=0.5, vertical=0.2, quadratic=0.03)
    rates = replace(RACER.airframe.rates, time_constant=0.06, integral_gain=10.0)
    other = with_airframe(other, rates=rates, delay=0.012)
    expected = fly(other, start, actions)
    for now, then in zip(flown.body, expected.body, strict=True):
        np.testing.assert_allclose(now[..., 1], then[..., 1], atol=1e-9)


def test_unused_parameters_are_not_there() -> None:
    """What is not randomised is no array of the state, so it costs nothing."""
    state = dynamics_of(RACER).init(jnp.zeros((3, 4)), jnp.zeros(4))
    assert jax.tree.leaves(state.parameters) == []
    heavy = dynamics_of(RACER).init(jnp.zeros((3, 4)), jnp.zeros(4), Parameters(mass=jnp.ones(4)))
    assert len(jax.tree.leaves(heavy)) == len(jax.tree.leaves(state)) + 1
    winding = dynamics_of(RACER).init(jnp.zeros((3, 4)), jnp.zeros(4), Parameters(integral_gain=jnp.ones(4)))
    assert [wound.shape for wound in winding.memory.controller] == [(4,)] * 3


def test_the_ground_holds_a_drone_up() -> None:
    start = state_of(RACER, position=(0.0, 0.0, 0.3), velocity=(1.0, 0.0, -2.0), thrust=0.0)
    states = fly(RACER, start, repeated(action_for(RACER, 0.0), 40))
    height, sinking = np.asarray(states.body.position_w)[:, 2], np.asarray(states.body.velocity_w)[:, 2]
    assert height.min() == 0
    assert sinking[-1] == 0
    assert (sinking[height > 0] < 0).all()


def test_wind_carries_a_drone_that_lets_itself_drift() -> None:
    """Level and hovering, its drag ends when it moves with the air."""
    start = state_of(RACER)._replace(parameters=Parameters(wind_w=jnp.array([3.0, -2.0, 0.0])))
    end = fly(RACER, start, repeated(action_for(RACER, WEIGHT), 2000)).body.velocity_w[-1]
    np.testing.assert_allclose(end, [3.0, -2.0, 0.0], atol=1e-3)


def test_actions_beyond_one_count_as_one() -> None:
    wild = np.array([3.0, -7.0, 1.5, 0.2])
    flown, expected = (fly(RACER, state_of(RACER), repeated(a, 5)) for a in (wild, np.clip(wild, -1, 1)))
    assert_trees_close(flown, expected)
