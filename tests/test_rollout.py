"""Rollouts are the environment stepped by hand, whatever the chunks and whoever flies."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise import rollout
from cruise.env.race_env import make_race_env
from cruise.errors import CruiseError
from cruise.pilots.neural import NeuralPilot
from cruise.pilots.scripted import SCRIPTED, Chaser
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.field import rows
from cruise.rollout import fly, fly_from, team_rules
from tests.storage.policies import random_params

RACES = 6
KEY = jax.random.key(11)


class Noise(eqx.Module):
    """Random actions about a mean of its own; counts its steps."""

    mean: float = eqx.field(static=True)
    name: str = eqx.field(static=True, default="noise")
    agility: float = eqx.field(static=True, default=5.0)
    vehicle: str = eqx.field(static=True, default="paper")

    def init(self, env, drones, state):
        return jnp.zeros((), jnp.int32)

    def act(self, env, drones, memory, state, key):
        shape = (3, *rows(state.next_gate, drones, 0).shape)
        return memory + 1, self.mean + 0.1 * jax.random.uniform(key, shape, minval=-1.0)


@pytest.fixture(scope="module")
def env():
    return make_race_env(TRACKS["ring"], 3, VEHICLES["paper"])


@pytest.fixture(scope="module")
def team():
    """Three pilots of three kinds: the second and third with memory, or randomness, or both."""
    params = jax.tree.map(lambda x: 2 * x, random_params(drones=3))
    return [NeuralPilot(params, "extended", 3, 7.5, "net"), SCRIPTED["hover"], Noise(0.3)]


def equal(a, b):
    return all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


def start_and_rules(env, team, gates=16):
    return rollout.start_races(env, jax.random.key(2), (RACES,)), team_rules(team, 0.25, gates, (RACES,))


def test_exact_for_any_chunk(env, team):
    state, rules = start_and_rules(env, team)
    assert equal(fly_from(env, team, rules, state, KEY, 60, 7), fly_from(env, team, rules, state, KEY, 60))


def test_a_longer_limit_adds_and_changes_nothing(env, team):
    state, rules = start_and_rules(env, team)
    short, long = (fly_from(env, team, rules, state, KEY, steps) for steps in (25, 60))
    assert len(short.action) == 25
    np.testing.assert_array_equal(short.position_w, long.position_w[:26])
    np.testing.assert_array_equal(short.action, long.action[:25])


def test_equals_the_environment_stepped_by_hand(env, team):
    state, rules = start_and_rules(env, team)
    flight = fly_from(env, team, rules, state, KEY, 60)
    step = jax.jit(env.step)
    for k, action in enumerate(flight.action):
        np.testing.assert_allclose(flight.position_w[k], state.drones.position_w, atol=2e-3)
        np.testing.assert_array_equal(flight.airborne[k], state.airborne)
        np.testing.assert_array_equal(flight.next_gate[k], state.next_gate)
        state, outcome = step(state, action, rules)
        np.testing.assert_array_equal(flight.crossing.passed[k], outcome.crossing.passed)
        for mine, theirs in zip(flight.collisions, outcome.collisions, strict=True):
            np.testing.assert_array_equal(mine[k], theirs)


def test_each_drone_is_flown_by_its_own_pilot(env):
    same = Noise(0.5)
    team = [same, Noise(-0.5), same]
    state, rules = start_and_rules(env, team)
    action = fly_from(env, team, rules, state, KEY, 3).action
    assert (action[:, :, [0, 2]] > 0.3).all()
    assert (action[:, :, 1] < -0.3).all()
    assert not np.array_equal(action[:, :, 0], action[:, :, 2])


def test_agility_is_each_pilots_own(env):
    rules = team_rules([Noise(0.5, agility=2.0), SCRIPTED["hover"], Chaser(agility=4.0)], 0.25, 16, (RACES,))
    np.testing.assert_array_equal(rules.agility, np.array([[2.0], [7.5], [4.0]], np.float32))
    assert team_rules([Noise(0.5)], 0.25, 16).agility.shape == (1,)


def test_each_kind_of_observation_is_computed_once(env):
    calls = []
    counted = {
        kind: lambda state, kind=kind, observe=observe: calls.append(kind) or observe(state)
        for kind, observe in env.observe_as.items()
    }
    extended = [NeuralPilot(random_params(drones=3, seed=s), "extended", 3, 7.5, f"net {s}") for s in (0, 1)]
    paper = NeuralPilot(random_params(drones=3, observation="paper"), "paper", 3, 7.5, "paper")
    team = [*extended, paper]
    watched = env._replace(observe_as=counted)
    groups, state = rollout.crews(team), jax.eval_shape(env.reset, KEY)
    act = functools.partial(rollout.act_together, watched, groups, ((), (), ()))
    _, action = jax.eval_shape(lambda state: act(state, KEY), state)
    assert sorted(calls) == ["extended", "paper"]
    assert action.shape == (3, 3)


def test_ends_when_every_race_is_over(env):
    """Drones that only climb leave the track."""
    team = [Noise(1.0)] * 3
    state, rules = start_and_rules(env, team)
    flight = fly_from(env, team, rules, state, KEY, 100_000)
    assert len(flight.action) < 200
    assert not flight.airborne[-1].any()
    assert flight.airborne[-2].any()
    assert flight.collisions.bounds.any(axis=0).any()


def test_who_is_out_stands_still_and_does_nothing(env):
    team = [Noise(1.0)] * 3
    state, rules = start_and_rules(env, team)
    flight = fly_from(env, team, rules, state, KEY, 1000)
    out = ~flight.airborne[:-1]
    assert out.any()
    moved = np.diff(flight.position_w, axis=0) != 0
    assert not (moved.any(axis=1) & out).any()
    assert not (flight.action.any(axis=1) & out).any()


def test_one_race_without_batch_axes(env):
    team = [Noise(1.0)] * 3
    rules = team_rules(team, 0.25, 16)
    flight = fly(env, team, rules, KEY, 20, gate=3)
    assert flight.position_w.shape == (21, 3, 3)
    assert (flight.next_gate[0] == 3).all()


def test_same_key_same_flight_other_key_another(env, team):
    _, rules = start_and_rules(env, team)
    first, again, other = (fly(env, team, rules, jax.random.key(k), 20, (RACES,)) for k in (1, 1, 2))
    assert equal(first, again)
    assert not np.array_equal(first.position_w, other.position_w)


def test_a_team_has_a_pilot_for_every_drone(env):
    team = [SCRIPTED["hover"]] * 2
    with pytest.raises(CruiseError, match="a race of 3 drones needs 3 pilots, not 2"):
        fly(env, team, team_rules(team, 0.25, 16), KEY, 10)
