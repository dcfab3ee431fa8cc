"""A policy as a pilot: the network's action in the world's frame, and races it does not fit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cruise.env.race_env import make_race_env
from cruise.errors import CruiseError
from cruise.pilots.base import crews
from cruise.pilots.neural import NeuralPilot
from cruise.pilots.scripted import SCRIPTED
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.field import rows
from tests.storage.policies import random_params

KEY = jax.random.key(0)


def make_env(drones=2, track="ring"):
    return make_race_env(TRACKS[track], drones, VEHICLES["paper"])


def reset(env, races, seed=1):
    """A random start, compiled."""
    return jax.jit(env.reset, static_argnums=1)(jax.random.key(seed), (races,))


def standing(env):
    """Shapes of a start."""
    return jax.eval_shape(env.reset, KEY)


def act(pilot, env, drones, state):
    """Its action, compiled."""
    return jax.jit(lambda state: pilot.act(env, drones, (), state, KEY)[1])(state)


def perceptron(layers, x):
    """The network in double precision, written out."""
    for i, layer in enumerate(layers):
        x = np.asarray(layer.weight, np.float64) @ x + np.asarray(layer.bias, np.float64)
        if i < len(layers) - 1:
            x = np.tanh(x)
    return x


def loud_params(**kind):
    """Random parameters whose actions reach the limits."""
    params = random_params(**kind)
    return jax.tree.map(lambda x: 3 * x, params)


@pytest.mark.parametrize("observation", ["extended", "paper"])
def test_action_is_the_clipped_network_in_the_world(observation):
    env = make_env()
    state = reset(env, 5)
    params = loud_params(observation=observation)
    pilot = NeuralPilot(params, observation, 2, 7.5, "test")
    assert pilot.init(env, (0, 1), state) == ()
    action = act(pilot, env, (0, 1), state)
    observed = np.asarray(jax.jit(env.observe_as[observation])(state), np.float64)
    for drone, race in np.ndindex(2, 5):
        spoken = perceptron(params.actor.layers, observed[:, drone, race])
        if observation == "extended":
            yaw = TRACKS["ring"].gates[int(state.next_gate[drone, race])].yaw
            c, s = np.cos(yaw), np.sin(yaw)
            spoken = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ spoken
        np.testing.assert_allclose(action[:, drone, race], np.clip(spoken, -1, 1), atol=1e-4)


def test_a_policy_on_the_body_observation_flies_in_any_field():
    params = loud_params(drones=2, observation="body")
    pilot = NeuralPilot(params, "body", 2, 7.5, "test")
    for drones in (1, 2, 5):
        env = make_env(drones)
        assert pilot.init(env, tuple(range(drones)), standing(env)) == ()
        state = jax.eval_shape(env.reset, KEY)
        _, action = jax.eval_shape(lambda s, env=env: pilot.act(env, (0,), (), s, KEY), state)
        assert action.shape == (3, 1)


def test_flies_the_drones_it_is_given():
    env = make_env(3)
    state = reset(env, 4)
    pilot = NeuralPilot(loud_params(drones=3), "extended", 3, 7.5, "test")
    everyone, some = (act(pilot, env, drones, state) for drones in ((0, 1, 2), (2, 0)))
    np.testing.assert_allclose(some, everyone[:, np.array([2, 0])], atol=1e-6)


def test_races_it_does_not_fit():
    pilot = NeuralPilot(random_params(), "extended", 2, 7.5, "test")
    with pytest.raises(CruiseError, match="'test' was trained for races of 2 drones, this race has 3"):
        pilot.init(make_env(3), (0, 1, 2), standing(make_env(3)))
    on_ring = NeuralPilot(random_params(observation="paper"), "paper", 2, 7.5, "test")
    eight = make_env(track="figure-eight")
    with pytest.raises(CruiseError, match=r"reads 22 numbers, but the 'paper' observation has 23 in this race"):
        on_ring.init(eight, (0, 1), standing(eight))
    wide = NeuralPilot(random_params(actions=4), "extended", 2, 7.5, "test")
    with pytest.raises(CruiseError, match="gives 4 numbers, but this vehicle's action has 3"):
        wide.init(make_env(), (0, 1), standing(make_env()))


def test_crews_put_equal_pilots_together():
    chaser, hover = SCRIPTED["chaser"], SCRIPTED["hover"]
    grouped = crews([chaser, hover, chaser, chaser])
    assert [(crew.pilot.name, crew.drones) for crew in grouped] == [("chaser", (0, 2, 3)), ("hover", (1,))]


def test_rows():
    values = jnp.arange(12).reshape(2, 3, 2)
    np.testing.assert_array_equal(rows(values, (2, 0), axis=1), values[:, [2, 0]])
    assert rows(values, (0, 1, 2), axis=1) is values
