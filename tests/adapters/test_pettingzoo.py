"""PettingZoo's environment: every drone an agent, alone and in batches."""

import jax.numpy as jnp
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import cruise
from cruise.errors import CruiseError

THREE = {"track": "ring", "drones": 3}


def test_pettingzoos_own_tests(recwarn):
    parallel_api_test(cruise.parallel_env(**THREE, episode_steps=30), num_cycles=60)
    parallel_seed_test(lambda: cruise.parallel_env(**THREE, episode_steps=30), num_cycles=40)
    assert [str(w.message) for w in recwarn] == []


def up(agents, how_much):
    return {agent: np.array([0.0, 0.0, how_much[agent]], np.float32) for agent in agents}


def test_who_crashes_leaves_and_the_others_fly_on():
    env = cruise.parallel_env(**THREE, episode_steps=80)
    observations, infos = env.reset(seed=3)
    assert env.agents == env.possible_agents == ["drone_0", "drone_1", "drone_2"]
    assert all(observations[agent] in env.observation_space(agent) for agent in env.agents)
    assert infos["drone_1"]["gates_passed"] == 0
    how_much = {"drone_0": 0.0, "drone_1": -1.0, "drone_2": 0.0}  # drone_1 sinks to the ground
    left = {}
    for step in range(80):
        flown = list(env.agents)
        observations, rewards, terminated, truncated, infos = env.step(up(flown, how_much))
        for told in (observations, rewards, terminated, truncated, infos):
            assert list(told) == flown
        for agent in flown:
            if terminated[agent] or truncated[agent]:
                left[agent] = (step, terminated[agent], truncated[agent], infos[agent]["collision_ground"])
        assert env.agents == [agent for agent in flown if agent not in left]
    assert left["drone_1"][1:] == (True, False, True)
    assert left["drone_1"][0] < 79
    assert left["drone_0"] == left["drone_2"] == (79, False, True, False)
    assert env.agents == []
    assert env.reset()[0].keys() == set(env.possible_agents)


def test_the_batch_is_many_single_races():
    options = {**THREE, "episode_steps": 12}
    many, singles = cruise.vector_parallel_env(2, **options), [cruise.parallel_env(**options) for _ in range(2)]
    told = many.reset(seed=11)[0]
    alone = [env.reset(seed=11 + race)[0] for race, env in enumerate(singles)]
    rng = np.random.default_rng(0)
    for _ in range(30):
        for race, one in enumerate(alone):
            for agent, value in one.items():
                np.testing.assert_allclose(told[agent][race], value, atol=2e-4)
        actions = {agent: rng.uniform(-1, 1, (2, 3)).astype(np.float32) for agent in many.agents}
        told, rewards, terminated, truncated, infos = many.step(actions)
        for race, env in enumerate(singles):
            flown = list(env.agents)
            seen, gains, ended, late, details = env.step({agent: actions[agent][race] for agent in flown})
            for agent in many.agents:
                assert infos[agent]["active"][race] == (agent in flown)
                assert terminated[agent][race] == ended.get(agent, False)
                assert truncated[agent][race] == late.get(agent, False)
                assert rewards[agent][race] == pytest.approx(gains.get(agent, 0.0), abs=2e-4)
            if env.agents:
                alone[race] = {agent: seen[agent] for agent in env.agents}
                continue
            for agent in flown:  # over: the batch shows the next episode, and the last sight of this one beside it
                assert infos[agent]["_final_obs"][race]
                np.testing.assert_allclose(infos[agent]["final_obs"][race], seen[agent], atol=2e-4)
                assert infos[agent]["final_info"]["time"][race] == pytest.approx(details[agent]["time"])
            alone[race] = env.reset()[0]


def test_a_policy_flies_every_agent():
    """All drones of the shipped policy finish a lap, as they do in `cruise race`."""
    policy = cruise.load_policy("ring-2")
    env = cruise.vector_parallel_env(4, track="ring", drones=2, stage="race", laps=1)
    observations, _ = env.reset(seed=0)
    finished = np.zeros((4, 2), bool)
    for _ in range(200):
        actions = {a: np.asarray(policy.params.mean_action(jnp.asarray(o.T))).T for a, o in observations.items()}
        observations, _, terminated, _, infos = env.step(actions)
        for k, agent in enumerate(env.agents):
            last = infos[agent].get("final_info", {"finished": np.zeros(4, bool)})
            finished[:, k] |= terminated[agent] & (infos[agent]["finished"] | last["finished"])
    assert finished.all()


def test_state_for_critics():
    env = cruise.parallel_env(**THREE)
    observations, _ = env.reset(seed=0)
    assert env.state() in env.state_space
    np.testing.assert_allclose(env.state(), np.concatenate([observations[agent] for agent in env.agents]), atol=1e-6)


def test_refused():
    with pytest.raises(CruiseError, match="here every drone is an agent: opponents are for"):
        cruise.parallel_env(opponents=["chaser"])
    env = cruise.parallel_env(**THREE)
    env.reset(seed=0)
    with pytest.raises(CruiseError, match="agent 'drone_2' has no action; there must be one for each of drone_0, "):
        env.step({agent: np.zeros(3) for agent in env.agents[:2]})
    with pytest.raises(CruiseError, match=r"action of 'drone_0' has shape \[4\], expected \[3\]"):
        env.step({agent: np.zeros(4) for agent in env.agents})
    with pytest.raises(CruiseError, match="num_envs must be 1 or more, got 0"):
        cruise.vector_parallel_env(0)
