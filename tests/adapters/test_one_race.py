"""One race through every door: the same words and the same seed are the same race, state for state.

`cruise.race` flies it; every other door is told what its drones were told there.
"""

import itertools
import json
import os
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import cruise
from cruise.adapters.gymnasium_env import RaceEnv
from cruise.adapters.gymnasium_vector import VectorFieldEnv, VectorRaceEnv
from cruise.cli.main import main
from cruise.evaluation.metrics import race_result
from cruise.evaluation.summary import summarise
from cruise.storage.race_log import load_race_log
from cruise.tracks import TRACKS

SEEDS, STEPS = 5, 10
SCHEDULED = f"{Path(__file__).parent / 'scheduled.py'}:Scheduled"
LINE_UPS = ((), ("chaser",), ("chaser", SCHEDULED))
# What is raced, and the observation in whose frame actions are the vehicle's own.
RACES = {
    "paper": ({"track": "ring", "vehicle": "paper", "sensing": "range", "randomise": 0.5}, "paper"),
    "racer and crazyflie": ({"track": "ring", "vehicle": ["racer", "crazyflie"], "randomise": 0.3}, "racing-near"),
    "crazyflie": (
        {"track": "upenn-walls", "vehicle": "crazyflie", "sensing": "camera", "spread_starts": 0.5},
        "racing-near",
    ),
}
ALL = list(itertools.product(RACES, LINE_UPS))
# CRUISE_ALL_DOORS=1 for all nine through all doors, which takes minutes.
EVERYTHING = "CRUISE_ALL_DOORS" in os.environ
CASES = ALL if EVERYTHING else [ALL[4], ALL[6]]


def stepped(env, tell):
    """Positions [T, 3, N, E] and rewards [T, R] of an environment that is told what `tell` gives for every step."""
    env.reset(seed=0)
    position, rewards = [env._races.state.drones.position_w], []
    for step in range(STEPS):
        rewards.append(env.step(tell(step))[1])
        position.append(env._races.state.drones.position_w)
    return np.stack(position), rewards


def gymnasium_many(versus, told):
    return stepped(VectorRaceEnv(SEEDS, **versus), lambda step: told[step, :, 0])


def gymnasium_one_by_one(versus, told):
    env, flown = RaceEnv(**versus), []
    for seed in range(SEEDS):
        env.reset(seed=seed)
        flown.append([env._races.state.drones.position_w])
        for step in range(STEPS):
            env.step(told[step, seed, 0])
            flown[-1].append(env._races.state.drones.position_w)
    return np.concatenate([np.stack(one) for one in flown], axis=-1), None


def field(all_learn, told):
    drones = all_learn["drones"]
    position, rewards = stepped(VectorFieldEnv(SEEDS * drones, **all_learn), lambda k: np.concatenate(told[k]))
    return position, np.stack(rewards).reshape(STEPS, SEEDS, drones)[:, :, 0]


def pettingzoo_many(all_learn, told):
    env = cruise.vector_parallel_env(SEEDS, **all_learn)
    position, rewards = stepped(env, lambda k: {a: told[k, :, i] for i, a in enumerate(env.agents)})
    return position, [gains["drone_0"] for gains in rewards]


def pettingzoo_one(all_learn, told):
    env = cruise.parallel_env(**all_learn)
    position, rewards = stepped(env, lambda k: {a: told[k, 0, i] for i, a in enumerate(env.agents)})
    return position, [[gains["drone_0"]] for gains in rewards]


def functional(versus, told):
    env = cruise.make(**versus)
    keys = jax.vmap(env.key_of)(jnp.arange(SEEDS))

    def step(state, action):
        _, state, reward, *_ = env.step(keys[0], state, action)
        return state, (positions(state), reward[0])

    return scanned(lambda: env.reset(keys)[1], step, told[:, :, : env.num_agents].transpose(0, 3, 2, 1))


def by_name(all_learn, told):
    env = cruise.make(**all_learn, layout="agents")
    keys = jax.vmap(env.key_of)(jnp.arange(SEEDS))

    def step(state, action):
        named = {a: action[:, i] for i, a in enumerate(env.agents)}
        _, state, rewards, *_ = jax.vmap(env.step)(keys, state, named)
        return state, (positions(state), rewards["drone_0"])

    return scanned(lambda: jax.vmap(env.reset)(keys)[1], step, told)


def positions(state):
    """[3, N, E], also of races that `vmap` has put first."""
    position = state.state.drones.body.position_w
    return position if len(position) == 3 else jnp.moveaxis(position, 0, -1)


def scanned(begin, step, told):
    @jax.jit
    def fly(told):
        state = begin()
        return positions(state), jax.lax.scan(step, state, told)[1]

    start, (position, reward) = fly(jnp.asarray(told))
    return np.concatenate([start[None], position]), reward


VERSUS = {"Gymnasium": gymnasium_one_by_one, "functional": functional}  # beside Gymnasium's many
ALL_LEARN = {"PettingZoo": pettingzoo_one, "PettingZoo, many": pettingzoo_many, "field": field, "by name": by_name}
IN_TURN = (("functional", "field"), ("by name", "PettingZoo, many"))


@pytest.mark.parametrize(("name", "others"), CASES, ids=lambda x: x if isinstance(x, str) else str(len(x)))
def test_the_same_race(name, others, tmp_path):
    race, observation = RACES[name]
    if not others and isinstance(race["vehicle"], list):
        race = race | {"vehicle": race["vehicle"][0]}
    asked = race | {"drones": len(others) + 1, "laps": 1}
    pilots = [SCHEDULED, *others]
    logs = [cruise.race(**asked, pilots=pilots, seed=seed) for seed in range(SEEDS)]
    flown = np.stack([log.position_w[: STEPS + 1] for log in logs], axis=-1).transpose(0, 2, 1, 3)
    told = np.stack([log.action[:STEPS] for log in logs], axis=1)  # [T, E, N, A]
    assert np.ptp(flown, axis=-1).min() > 1e-3  # five races, not one
    assert all(log.airborne[STEPS].all() for log in logs)

    all_learn = asked | {"stage": "race", "observation": observation}
    versus = all_learn | ({"opponents": list(others)} if others else {})
    chosen = (*VERSUS, *ALL_LEARN) if EVERYTHING else IN_TURN[CASES.index((name, others))]
    position, reward = gymnasium_many(versus, told)
    doors = {"Gymnasium, many": (position, None)}
    doors |= {door: fly(versus, told) for door, fly in VERSUS.items() if door in chosen}
    doors |= {door: fly(all_learn, told) for door, fly in ALL_LEARN.items() if door in chosen}
    for door, (position, gain) in doors.items():
        races = position.shape[-1]
        np.testing.assert_allclose(position, flown[..., :races], atol=2e-4, err_msg=door)
        if gain is not None:
            np.testing.assert_allclose(gain, np.stack(reward)[:, :races], atol=2e-3, err_msg=door)

    evaluated = cruise.evaluate(**asked, pilots=pilots, episodes=1, seed=1)
    measured = summarise(TRACKS[asked["track"]], tuple(logs[1].names), [race_result(logs[1])], 1)
    assert json.dumps(evaluated.to_dict()) == json.dumps(measured.to_dict())
    same(by_command(asked, pilots, tmp_path / "race.npz"), logs[1])


def by_command(asked, pilots, path):
    """The log of the race of seed 1."""
    vehicles = asked["vehicle"] if isinstance(asked["vehicle"], list) else [asked["vehicle"]]
    words = [word for one in pilots for word in ("--pilot", one)]
    words += [word for one in vehicles for word in ("--vehicle", one)]
    words += [f"--{key.replace('_', '-')}={value}" for key, value in asked.items() if key != "vehicle"]
    assert main(["race", *words, "--seed", "1", "--html", "None", "--png", "None", "--log", str(path)]) == 0
    return load_race_log(path)


def same(one, other):
    np.testing.assert_array_equal(one.position_w, other.position_w)
    np.testing.assert_array_equal(one.names, other.names)
