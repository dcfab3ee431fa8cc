"""Gymnasium's environment: it keeps to the interface, and its races are those that fly elsewhere."""

import subprocess
import sys
import warnings

import gymnasium
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import cruise
from cruise.adapters.gymnasium_env import RaceEnv
from cruise.adapters.gymnasium_vector import VectorRaceEnv
from cruise.errors import CruiseError
from tests.storage.policies import write_policy

DUEL = {"track": "ring", "opponents": ["chaser"]}
RACES, STEPS = 3, 25


@pytest.mark.parametrize("order", ["import cruise.gym, gymnasium", "import gymnasium, cruise.gym"])
def test_registered_whoever_is_imported_first(order):
    code = f"{order}\nassert gymnasium.spec('cruise/Race-v0').vector_entry_point\nimport sys\n"
    check = "assert not {'jax', 'pettingzoo', 'PIL'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code + check], check=True, timeout=120)


def test_the_name_alone_registers():
    code = (
        "import gymnasium\nassert gymnasium.make('cruise.gym:cruise/Race-v0', drones=1).spec.max_episode_steps == 600"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_cruise_alone_imports_nothing():
    alone = "import sys, cruise; assert not {'gymnasium', 'numpy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", alone], check=True, timeout=120)


def test_gymnasiums_own_check():
    env = gymnasium.make("cruise.gym:cruise/Race-v0", **DUEL, episode_steps=20)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message="no window can be shown here")
        check_env(env.unwrapped)


@pytest.fixture(scope="module")
def actions():
    return np.random.default_rng(0).uniform(-1, 1, (STEPS, RACES, 3)).astype(np.float32)


def same(ours, theirs, where):
    """Information nested in dictionaries, with masks; entries that the mask leaves out do not matter."""
    if isinstance(theirs, dict):
        assert isinstance(ours, dict), where
        for name, value in theirs.items():
            if name.startswith("_"):
                assert np.array_equal(ours[name], value), f"{where}.{name}"
            elif isinstance(value, dict):
                same(ours[name], value, f"{where}.{name}")
            else:
                told = theirs[f"_{name}"]
                for a, b in zip(np.asarray(ours[name])[told], value[told], strict=True):
                    np.testing.assert_allclose(a, b, atol=2e-4, err_msg=f"{where}.{name}")


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_vector_environment_does_as_gymnasiums_loop_over_single_ones(mode, actions):
    options = {**DUEL, "episode_steps": 9}
    ours = gymnasium.make_vec(
        "cruise.gym:cruise/Race-v0", RACES, vectorization_mode="vector_entry_point", autoreset_mode=mode, **options
    )
    loop = SyncVectorEnv([lambda: RaceEnv(**options)] * RACES, autoreset_mode=mode)
    assert isinstance(ours.unwrapped, VectorRaceEnv)
    assert ours.metadata["autoreset_mode"] is mode
    assert ours.single_observation_space == loop.single_observation_space
    assert (ours.observation_space, ours.action_space) == (loop.observation_space, loop.action_space)
    told = [ours.reset(seed=7), loop.reset(seed=7)]
    ended = 0
    for step in range(STEPS + 1):
        np.testing.assert_allclose(told[0][0], told[1][0], atol=2e-4, err_msg=f"observation {step}")
        assert told[0][0] in ours.observation_space
        same(told[0][-1], told[1][-1], f"info {step}")
        if step == STEPS:
            break
        told = [env.step(actions[step]) for env in (ours, loop)]
        for a, b in zip(told[0][1:4], told[1][1:4], strict=True):
            np.testing.assert_allclose(a, b, atol=2e-4)
        over = told[0][2] | told[0][3]
        ended += over.sum()
        if mode is AutoresetMode.SAME_STEP:
            assert ("final_obs" in told[0][-1]) == ("final_obs" in told[1][-1]) == over.any()
        if mode is AutoresetMode.DISABLED and over.any():
            told = [(env.reset(options={"reset_mask": over.copy()})) for env in (ours, loop)]
    assert ended >= 2 * RACES


def test_same_seed_same_episode_and_later_ones_differ():
    env = RaceEnv(**DUEL)
    first, again, other = (env.reset(seed=seed)[0] for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    env.reset(seed=5)
    assert not np.array_equal(env.reset()[0], first)
    unseeded = [RaceEnv(**DUEL).reset()[0] for _ in range(2)]
    assert not np.array_equal(*unseeded)


def climb(env, steps):
    """Full thrust upwards, until the track is left."""
    env.reset(seed=1)
    return [env.step(np.array([0.0, 0.0, 1.0], np.float32)) for _ in range(steps)]


def test_crashes_terminate_and_time_truncates():
    told = climb(RaceEnv(**DUEL), 60)
    ended = next(k for k, one in enumerate(told) if one[2])
    assert not any(one[3] for one in told[: ended + 1])
    assert told[ended][4]["collision_bounds"]
    assert told[ended][1] == -10.0
    late = climb(RaceEnv(**DUEL, episode_steps=10), 10)
    assert [(one[2], one[3]) for one in late] == [(False, False)] * 9 + [(False, True)]
    assert late[-1][4]["time"] == pytest.approx(1.0)


def test_the_components_sum_to_the_reward():
    races = RACES
    env = VectorRaceEnv(races, **DUEL, autoreset_mode="SameStep")
    env.reset(seed=0)
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(250):
        action = np.concatenate([rng.uniform(0, 1, (races, 1)), rng.uniform(-0.4, 0.4, (races, 2))], axis=1)
        observation, total, _, _, infos = env.step(action)
        assert observation in env.observation_space
        over = infos.get("_final_info", np.zeros(races, bool))
        for told, rows in ((infos, ~over), (infos.get("final_info"), over)):
            if rows.any():
                terms = {k: v[rows] for k, v in told.items() if k.startswith("reward_")}
                np.testing.assert_allclose(sum(terms.values()), total[rows], atol=1e-5)
                seen |= {name for name, value in terms.items() if value.any()}
    assert {f"reward_{name}" for name in ("prog", "speed", "align", "gate", "terminal")} <= seen


def test_a_policy_flies_here_the_race_that_it_flies_elsewhere(tmp_path):
    """The shipped policy for two drones, against itself, from the start of a race that `cruise.race` flew."""
    policy = cruise.load_policy("ring-2")
    log = cruise.race("ring", 2, "ring-2", laps=1, seed=4)
    env = VectorRaceEnv(1, track="ring", stage="race", laps=1, opponents="ring-2", autoreset_mode="Disabled")
    start = {"position_w": log.position_w[0], "gate": int(log.next_gate[0, 0])}
    observation, _ = env.reset(options={"start": start})
    finish = log.event_time[(log.event_kind_names[log.event_kind] == "finish") & (log.event_drone == 0)][0]
    for step in range(1, len(log.time)):
        action = np.asarray(policy.params.mean_action(jnp.asarray(observation.T))).T
        observation, _, terminated, truncated, infos = env.step(action)
        position = np.asarray(env._races.state.drones.position_w)[:, 0, 0]
        # Two programs round differently, and flight near the limit lets that grow: tenfold in half a second at times.
        np.testing.assert_allclose(position, log.position_w[step, 0], atol=1e-5 if step <= 20 else 0.5)
        if terminated[0]:
            break
    assert infos["finished"][0]
    assert not truncated[0]
    assert infos["gates_passed"][0] == 6
    assert (step - 1) * 0.1 <= finish <= step * 0.1


class CountsItsObjects:
    """An opponent in Python, with a memory."""

    made = 0

    def __init__(self):
        CountsItsObjects.made += 1
        self.steps = 0

    def act(self, view):
        assert view.time == pytest.approx(0.1 * self.steps)
        assert view.drone == 1
        self.steps += 1
        return [0.0, 0.0, 0.0]


def test_opponents_in_python():
    CountsItsObjects.made = 0
    env = VectorRaceEnv(RACES, track="ring", opponents=[CountsItsObjects], episode_steps=5)
    env.reset(seed=0)
    for _ in range(13):
        env.step(np.zeros((RACES, 3), np.float32))
    assert CountsItsObjects.made == RACES * 3  # one for every race, three episodes


def test_another_vehicle_and_its_observation():
    env = RaceEnv(track="ring", drones=1, vehicle="racer", observation="body", episode_steps=5)
    observation, _ = env.reset(seed=0)
    assert env.action_space.shape == (4,)
    assert observation in env.observation_space
    assert env.metadata["render_fps"] > 10
    for step in range(5):
        observation, reward, terminated, truncated, _ = env.step(np.zeros(4, np.float32))
        assert observation in env.observation_space
        assert np.isfinite(reward)
        assert (terminated, truncated) == (False, step == 4)


def test_from_where_it_is_asked_with_all_else_by_chance():
    """Moved gates and sensors are drawn whoever says where a race starts, and for the next one."""
    env = VectorRaceEnv(2, track="ring", drones=1, randomise=1.0, sensing="range", episode_steps=2)
    start = {"position_w": [[[-12.0, -5.0, 2.0]], [[-12.0, -4.0, 2.0]]], "gate": [0, 1]}
    env.reset(seed=0, options={"start": start})
    state = env._races.state
    np.testing.assert_allclose(state.drones.position_w[:, 0].T, np.array(start["position_w"])[:, 0])
    assert state.next_gate.tolist() == [[0, 1]]
    assert np.ptp(state.surroundings.gates.position_w, axis=-1).min() > 0
    for _ in range(3):
        env.step(np.zeros((2, 3), np.float32))
    assert np.abs(env._races.state.drones.position_w[:, 0].T - np.array(start["position_w"])[:, 0]).min() > 0.01


def test_text():
    env = gymnasium.make("cruise.gym:cruise/Race-v0", **DUEL, render_mode="ansi")
    env.reset(seed=2)
    text = env.render()
    assert text.startswith("ring, 0.0 s\n")
    assert "1 learner: 0 gates,  0.0 m/s, to gate " in text
    assert "2 chaser: " in text
    assert all(letter in text for letter in "ABCDE")


def test_pictures_show_the_drones():
    env = gymnasium.make("cruise.gym:cruise/Race-v0", **DUEL, render_mode="rgb_array")
    env.reset(seed=2)
    before = env.render()
    for _ in range(10):
        env.step(np.zeros(3, np.float32))
    after = env.render()
    assert before.shape == after.shape == (480, 640, 3)
    assert (before != after).any()
    for colour in ((0x00, 0x72, 0xB2), (0xE6, 0x9F, 0x00)):  # of the learner and its opponent
        assert (np.abs(after.astype(int) - colour).sum(axis=2) < 12).sum() > 40
    many = VectorRaceEnv(RACES, **DUEL, render_mode="rgb_array")
    many.reset(seed=[2, 3, 4])
    frames = many.render()
    assert len(frames) == RACES
    np.testing.assert_array_equal(frames[0], before)


BAD = {
    "option": (
        {"trak": "ring"},
        "unexpected keyword argument 'trak' of a race: did you mean 'track'? options: track, ",
    ),
    "track": ({"track": "rink"}, "unknown track 'rink': did you mean 'ring'?"),
    "stage": ({"stage": 6}, "stage must be from 1 to 5, or 'race', got 6"),
    "laps": ({"laps": 3}, "laps are those of a real race: give stage='race' with them"),
    "many laps": ({"laps": 0, "stage": "race"}, "laps must be from 1 to 100, got 0"),
    "reward": ({"reward": "money"}, "unknown reward 'money'; there are default, paper"),
    "vehicle": ({"vehicle": "kite"}, "unknown vehicle 'kite'"),
    "drones": ({"drones": 0}, "drones must be from 1 to 64, got 0"),
    "opponents": ({"drones": 2, "opponents": ["chaser", "hover"]}, "2 opponents in a race of 2 drones: one learns"),
    "alone": ({"drones": 1, "opponents": ["chaser"]}, "a race of 1 drone has no opponents"),
    "unknown": ({"opponents": ["ace"]}, "policy 'ace' not found"),
    "not shipped": ({"drones": 9}, "no policy is shipped for track 'ring' with 9 drones"),
    "agility": ({"agility": -1.0}, "agility must be above 0 and finite, got -1.0"),
    "time": ({"episode_steps": 0}, "episode_steps must be 1 or more, got 0"),
    "sensing": ({"sensing": "sonar"}, "unknown sensing 'sonar'; there are exact, range, camera, or a Sensing"),
    "spread": ({"spread_starts": 2}, "spread_starts must be from 0 to 1, got 2"),
    "field": ({"vehicle": ["paper", "racer"]}, "vehicles 'paper' and 'racer' cannot share a race: "),
    "vehicles": ({"vehicle": ["paper"] * 3, "drones": 2}, "3 vehicles for 2 drones: give one for all, or at most"),
    "render": ({"render_mode": "video"}, "unknown render_mode 'video'; there are rgb_array, human, ansi"),
}


@pytest.mark.parametrize("case", BAD)
def test_refused(case):
    options, message = BAD[case]
    with pytest.raises(CruiseError) as error:
        RaceEnv(**options)
    assert message in str(error.value)


def test_refused_while_flying(tmp_path):
    env = RaceEnv(**DUEL)
    with pytest.raises(CruiseError, match="was not reset"):
        env.step(np.zeros(3, np.float32))
    with pytest.raises(CruiseError, match=r"options\['start'\] must be a dictionary with 'position_w' and 'gate'"):
        env.reset(seed=0, options={"start": [1, 2]})
    with pytest.raises(CruiseError, match="a gate from 0 to 4"):
        env.reset(seed=0, options={"start": {"position_w": np.ones((2, 3)), "gate": 5}})
    env.reset(seed=0)
    with pytest.raises(CruiseError, match=r"action has shape \[2\], expected \[3\]"):
        env.step(np.zeros(2, np.float32))
    with pytest.raises(CruiseError, match="must be finite"):
        env.step(np.array([0.0, np.nan, 0.0], np.float32))
    with pytest.raises(CruiseError, match="2 seeds for 3 races"):
        VectorRaceEnv(3, **DUEL).reset(seed=[1, 2])
    env = RaceEnv(track="ring", opponents=[write_policy(tmp_path / "p", drones=3)])
    with pytest.raises(CruiseError, match="was trained for races of 3 drones, this race has 2"):
        env.reset(seed=0)
