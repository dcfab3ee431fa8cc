"""Environments in other processes, in pickles and in copies."""

import copy
import os
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import cruise
from cruise.adapters import workers
from cruise.adapters.gymnasium_env import RaceEnv
from cruise.adapters.gymnasium_vector import VectorRaceEnv
from cruise.errors import CruiseError

DUEL = {"track": "ring", "opponents": ["chaser"], "episode_steps": 9}

# Constructors of every door start nothing, so that a process that has them may fork.
FORKED = """
import os
os.environ["JAX_PLATFORMS"] = "cpu"
import numpy as np, gymnasium, cruise, cruise.gym
from jax._src import xla_bridge
options = dict(track="ring", opponents=["chaser"], episode_steps=9)
gymnasium.make_vec("cruise/Race-v0", 3, **options), gymnasium.make_vec("cruise/Field-v0", 4, drones=2)
cruise.parallel_env(drones=2), gymnasium.make("cruise/Race-v0", vehicle="racer", drones=4)
assert not xla_bridge.backends_are_initialized()
envs = gymnasium.make_vec("cruise/Race-v0", 2, vectorization_mode="async", vector_kwargs={"context": "fork"}, **options)
first = envs.reset(seed=3)[0]
told = [envs.step(np.zeros((2, 3), np.float32)) for _ in range(10)]
assert told[8][3].all() and not told[9][3].any()
envs.close()
np.save("first.npy", first)
"""


def test_forked_workers_fly(tmp_path):
    subprocess.run([sys.executable, "-W", "error::UserWarning", "-c", FORKED], cwd=tmp_path, check=True, timeout=400)
    first = np.load(tmp_path / "first.npy")
    np.testing.assert_allclose(first, VectorRaceEnv(2, **DUEL).reset(seed=3)[0], atol=1e-5)


def test_a_fork_of_a_process_in_which_jax_runs_is_told(monkeypatch):
    monkeypatch.setattr(workers, "_ran_in", os.getpid() + 1)
    for env in (RaceEnv(**DUEL), VectorRaceEnv(2, **DUEL), cruise.parallel_env(drones=2)):
        with pytest.raises(CruiseError, match="JAX was running when this process was forked"):
            env.reset(seed=0)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_flies_on_as_its_original(again):
    env = RaceEnv(**DUEL, render_mode="rgb_array")
    fresh = again(env)
    np.testing.assert_array_equal(fresh.reset(seed=2)[0], env.reset(seed=2)[0])
    env.step(np.zeros(3, np.float32))
    before = env.render()
    other = again(env)
    np.testing.assert_array_equal(other.render(), before)
    for _ in range(3):
        action = np.array([0.3, -0.2, 0.1], np.float32)
        for ours, theirs in zip(other.step(action)[:4], env.step(action)[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_the_time_limit_is_known_by_every_name():
    made = [gymnasium.make_vec("cruise.gym:cruise/Race-v0", 2, drones=1, max_episode_steps=7)]
    made += [gymnasium.make("cruise.gym:cruise/Race-v0", drones=1, max_cycles=7)]
    assert [env.spec.max_episode_steps for env in made] == [7, 7]
    assert cruise.parallel_env(drones=2, max_cycles=7).max_cycles == 7
    assert not isinstance(made[1], gymnasium.wrappers.TimeLimit)
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        RaceEnv(frameskip=1)


def test_information_is_numpys_scalars():
    env = RaceEnv(**DUEL)
    info = env.reset(seed=0)[1]
    assert all(isinstance(value, np.generic) for value in info.values())
    assert env.step(np.zeros(3, np.float32))[4].keys() == info.keys()


def test_keys_for_play():
    env = RaceEnv(**DUEL)
    keys = env.get_keys_to_action()
    np.testing.assert_array_equal(keys["w",], [1, 0, 0])
    np.testing.assert_array_equal(keys["w", "a"], [1, 1, 0])
    assert all(action in env.action_space for action in keys.values())


def test_a_field_is_rows_of_races():
    """Every drone a row: what PettingZoo's batch tells of the same seeds."""
    rows = gymnasium.make_vec("cruise.gym:cruise/Field-v0", 6, drones=3, episode_steps=12, autoreset_mode="SameStep")
    zoo = cruise.vector_parallel_env(2, drones=3, episode_steps=12)
    seen, told = rows.reset(seed=5)[0], zoo.reset(seed=5)[0]
    rng = np.random.default_rng(0)
    ended = np.zeros(6, bool)
    for _ in range(14):
        np.testing.assert_array_equal(seen.reshape(2, 3, -1), np.stack([told[a] for a in zoo.agents], axis=1))
        actions = rng.uniform(-1, 1, (2, 3, 3)).astype(np.float32)
        seen, reward, terminated, truncated, infos = rows.step(actions.reshape(6, 3))
        told, gains, out, _, details = zoo.step({a: actions[:, k] for k, a in enumerate(zoo.agents)})
        np.testing.assert_array_equal(reward.reshape(2, 3), np.stack([gains[a] for a in zoo.agents], axis=1))
        np.testing.assert_array_equal(terminated.reshape(2, 3), np.stack([out[a] for a in zoo.agents], axis=1))
        active = np.stack([details[a]["active"] for a in zoo.agents], axis=1)
        np.testing.assert_array_equal(infos["active"].reshape(2, 3), active)
        ended |= terminated | truncated
    assert ended.all()
    with pytest.raises(CruiseError, match="num_envs must be a multiple of the 3 drones of a race, got 4"):
        gymnasium.make_vec("cruise.gym:cruise/Field-v0", 4, drones=3)
