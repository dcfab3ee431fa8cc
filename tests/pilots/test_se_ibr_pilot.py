"""The planner as a pilot: any number of drones, any company, any track; the vehicle does what the plan wants."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.dynamics import DroneState, RigidBody, make_dynamics
from cruise.env.race_env import make_race_env
from cruise.errors import CruiseError
from cruise.pilots.named import NAMED
from cruise.pilots.se_ibr import Algorithm, SeIbrPilot, Style
from cruise.pilots.se_ibr.tracking import CascadeTracker, Moment
from cruise.pilots.se_ibr.trajectory import make_trajectory
from cruise.presets import TRACKS, VEHICLES
from cruise.rollout import fly, team_rules
from tests.racing.obstacles import distance, pole_in_the_way, wall_in_the_way, with_solids

PAPER = VEHICLES["paper"]
KEY = jax.random.key(3)
TUNED = NAMED["se-ibr-tuned"]
SHORT = Algorithm(horizon=6, iterations=3)  # quick to compile, where it does not matter how well it plans


@pytest.mark.parametrize(("drones", "batch"), [(1, (2,)), (16, ())])
def test_any_number_of_drones(drones, batch):
    env = make_race_env(TRACKS["ring"], drones, PAPER)
    everyone = tuple(range(drones))
    pilot = dataclasses.replace(TUNED, algorithm=SHORT)

    def first_action(key):
        state = env.reset(key, batch)
        return pilot.act(env, everyone, pilot.init(env, everyone, state), state, key)[1]

    action = jax.jit(first_action)(KEY)
    assert action.shape == (3, drones, *batch)
    assert 0.1 < np.abs(action).max() <= 1.0


@pytest.fixture(scope="module")
def mixed():
    """Two drones of the planner and a chaser, over a lap of the figure-eight; in 2 of 128 such races one crashes."""
    env = make_race_env(TRACKS["figure-eight"], 3, PAPER)
    team = [TUNED, NAMED["chaser"], TUNED]
    rules = team_rules(team, PAPER.collision_distance, env.course.num_gates + 1, (8,))
    return fly(env, team, rules, jax.random.key(6), 500, (8,))


def test_flies_among_others(mixed):
    assert mixed.finished[-1][[0, 2]].all()
    assert not mixed.crossing.missed[:, [0, 2]].any()


def test_is_faster_than_who_does_not_plan(mixed):
    last = [
        np.where(mixed.crossing.passed[:, drone].any(0), mixed.airborne[:, drone].sum(0), 9999) for drone in range(3)
    ]
    assert (np.maximum(last[0], last[2]) < last[1]).mean() > 0.8


def test_who_flies_some_drones_flies_them_as_who_flies_all():
    """What a planner does with its drones does not depend on whether it is asked for all of them."""
    env = make_race_env(TRACKS["ring"], 3, PAPER)
    pilot = SeIbrPilot(Style(4.0, 1.7), algorithm=SHORT)

    def actions(key):
        state = env.reset(key, (4,))
        return [pilot.act(env, crew, pilot.init(env, crew, state), state, key)[1] for crew in ((0, 1, 2), (2, 0))]

    everyone, some = jax.jit(actions)(KEY)
    np.testing.assert_allclose(some, everyone[:, [2, 0]], atol=1e-4)


def test_plans_anew_every_tenth_of_a_second():
    """A vehicle with control steps of 0.02 s: one plan for five steps, and an action at each of them."""
    vehicle = VEHICLES["racer"]
    env = make_race_env(TRACKS["ring"], 1, vehicle)
    pilot = dataclasses.replace(TUNED.for_vehicle(vehicle), algorithm=SHORT)
    assert env.dynamics.control_dt == 0.02
    state = env.reset(KEY, (2,))
    act = jax.jit(lambda memory, state: pilot.act(env, (0,), memory, state, KEY))
    step = jax.jit(lambda state, action: env.step(state, action, team_rules([pilot], 0.25, 20, (2,)))[0])
    memory, plans, actions = pilot.init(env, (0,), state), [], []
    for _ in range(11):
        memory, action = act(memory, state)
        state = step(state, action)
        plans.append(np.asarray(memory.plan.position_w))
        actions.append(np.asarray(action))
    new = [k for k in range(1, 11) if not np.array_equal(plans[k], plans[k - 1])]
    assert new == [5, 10]
    assert all(not np.array_equal(a, b) for a, b in itertools.pairwise(actions))
    assert (state.drones.velocity_w**2).sum() > 1.0


def test_the_cascade_gives_the_acceleration_that_is_wanted():
    """Tilts act two steps after a command, thrust at once; `ahead` is where the drone then is."""
    env = make_race_env(TRACKS["ring"], 1, PAPER)
    tracker, agility, h = (
        CascadeTracker(PAPER, make_dynamics(PAPER)),
        30.0,
        PAPER.control_dt,
    )  # so agile that no action is clipped
    rng = np.random.default_rng(0)

    def drawn(limit):
        return rng.uniform(-limit, limit, (3, 1, 64)).astype(np.float32)

    velocity, level = drawn(3.0), np.array([1.0, 1.0, 0.0], np.float32).reshape(3, 1, 1)
    body = RigidBody(np.zeros_like(velocity), velocity, level * drawn(0.08), level * drawn(0.1))
    state, wanted = DroneState(body, drawn(0.1)), drawn(0.8)

    def flown(state, wanted):
        position, velocity = tracker.ahead(state)
        speeds = velocity[:, None] + 0.3 * wanted[:, None]  # reached after 0.3 s, then held
        planned = position[:, None] + 0.15 * np.arange(1, 4).reshape(-1, 1, 1) * speeds
        action = tracker.command(make_trajectory(position, velocity, planned, 0.15), Moment(state, 0.0, 0.3, agility))
        states = [env.dynamics.step(state, action, agility)]
        for _ in range(2):
            states.append(env.dynamics.step(states[-1], jnp.zeros_like(action), agility))
        return position, velocity, action, states

    position, velocity, action, (first, second, third) = jax.jit(flown)(jax.tree.map(jnp.asarray, state), wanted)
    assert np.abs(action).max() < 1.0
    np.testing.assert_allclose(second.position_w[:2], position[:2], atol=5e-3)
    np.testing.assert_allclose(second.velocity_w[:2], velocity[:2], atol=0.02)
    np.testing.assert_allclose((first.velocity_w[2] - body.velocity_w[2]) / h, wanted[2], atol=0.01)
    # Small angles and a thrust of m g are what the cascade assumes; the rest is what is left over.
    np.testing.assert_allclose((third.velocity_w - second.velocity_w)[:2] / h, wanted[:2], atol=0.15)


def test_a_trajectory_between_its_knots():
    """Uniform acceleration from rest: positions are interpolated, velocities linear, the end holds."""
    planned = np.array([[1.0, 3.0, 6.0], [0.0, 0.0, 0.0], [2.0, 4.0, 6.0]], np.float32)[..., None]  # [3, K, N]
    start, velocity = np.zeros((3, 1), np.float32), np.array([[0.0], [0.0], [2.0]], np.float32)
    plan = [jnp.asarray(array) for array in (start, velocity, planned)]
    at = jax.jit(lambda time: make_trajectory(*plan, 1.0).at(time))
    here = at(1.5)
    np.testing.assert_allclose(here.position_w[:, 0], [2.0, 0.0, 3.0], atol=1e-6)
    np.testing.assert_allclose(here.velocity_w[:, 0], [1.5, 0.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(here.acceleration_w[:, 0], [1.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(at(9.0).position_w[:, 0], [6.0, 0.0, 6.0], atol=1e-6)


def test_another_vehicle_than_its_own_is_refused():
    env = make_race_env(TRACKS["ring"], 1, VEHICLES["racer"])
    with pytest.raises(
        CruiseError, match="pilot 'se-ibr-tuned' flies vehicle 'paper', which is not the one of this race"
    ):
        TUNED.init(env, (0,), jax.eval_shape(env.reset, KEY))


def test_flies_around_a_pole_and_a_wall_that_stand_in_its_way():
    """Solids on the straight way of three legs, all flown: nobody touches them, and all finish their lap."""
    ring = TRACKS["ring"]
    solids = (pole_in_the_way(ring, 0), pole_in_the_way(ring, 2, radius=0.4), wall_in_the_way(ring, 3))
    env = make_race_env(with_solids(ring, *solids), 2, PAPER)
    team = [TUNED, TUNED]
    rules = team_rules(team, PAPER.collision_distance, env.course.num_gates + 1, (4,))
    flight = fly(env, team, rules, KEY, 300, (4,))
    assert not (flight.collisions.pole | flight.collisions.wall).any()
    assert flight.finished[-1].all()
    path = flight.position_w.swapaxes(0, 1).reshape(3, -1).T.astype(np.float64)
    assert 0.1 < min(distance(solid, path).min() for solid in solids) < 2.0  # near enough to have been in the way
