"""One race through every door: the same vehicle, opponents, rules, rewards, errors and starts, whoever opens it."""

import itertools
import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import cruise
from cruise.adapters.gymnasium_env import RaceEnv
from cruise.adapters.gymnasium_vector import VectorFieldEnv, VectorRaceEnv

SEEDS, STEPS = 5, 8
VEHICLES = ("paper", "racer", "crazyflie")
LINE_UPS = ((), ("chaser",), ("hover", "chaser"))
ALL = list(itertools.product(VEHICLES, LINE_UPS))
# Every vehicle and every line-up once; CRUISE_ALL_DOORS=1 for all nine, which takes minutes.
CASES = ALL if "CRUISE_ALL_DOORS" in os.environ else ALL[::4]


def gymnasium_one_by_one(options, actions):
    env = RaceEnv(**options)
    told = []
    for seed in range(SEEDS):
        first = env.reset(seed=seed)[0]
        steps = [env.step(action) for action in actions[:, seed]]
        told.append((np.stack([first, *(one[0] for one in steps)]), np.array([one[1] for one in steps])))
    return np.stack([seen for seen, _ in told], axis=1), np.stack([reward for _, reward in told], axis=1)


def gymnasium_many(options, actions, kind=VectorRaceEnv):
    env = kind(SEEDS, **options)
    first = env.reset(seed=0)[0]
    steps = [env.step(action) for action in actions]
    return np.stack([first, *(one[0] for one in steps)]), np.stack([one[1] for one in steps])


def functional(options, actions):
    env = cruise.make(**options)
    keys = jax.vmap(lambda seed: jax.random.fold_in(jax.random.key(seed), 0))(jnp.arange(SEEDS))

    def step(state, action):
        seen, state, reward, *_ = env.step(keys[0], state, action.T[:, None])
        return state, (seen[:, 0].T, reward[0])

    @jax.jit
    def fly():
        first, state = env.reset(keys)
        return first[:, 0].T, jax.lax.scan(step, state, jnp.asarray(actions))[1]

    first, (seen, reward) = fly()
    return np.concatenate([first[None], seen]), reward


def pettingzoo(options, actions):
    env = cruise.vector_parallel_env(SEEDS, **options)
    (agent,) = env.agents
    first = env.reset(seed=0)[0][agent]
    steps = [env.step({agent: action}) for action in actions]
    return np.stack([first, *(one[0][agent] for one in steps)]), np.stack([one[1][agent] for one in steps])


@pytest.mark.parametrize(("vehicle", "opponents"), CASES)
def test_the_same_race(vehicle, opponents):
    options = {"track": "ring", "vehicle": vehicle, "drones": len(opponents) + 1, "stage": 3}
    versus = options | {"opponents": list(opponents)}
    size = RaceEnv(**versus).action_space.shape[0]
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (STEPS, SEEDS, size)).astype(np.float32)
    flown = {
        "many": gymnasium_many(versus, actions),
        "one by one": gymnasium_one_by_one(versus, actions),
        "functional": functional(versus if opponents else options, actions),
    }
    if not opponents:
        flown["PettingZoo"] = pettingzoo(options, actions)
        flown["field"] = gymnasium_many(options, actions, VectorFieldEnv)
    seen, reward = flown.pop("many")
    assert np.ptp(seen, axis=1).any()
    for door, (other, gain) in flown.items():
        np.testing.assert_allclose(other, seen, atol=1e-3, err_msg=door)
        np.testing.assert_allclose(gain, reward, atol=1e-3, err_msg=door)
