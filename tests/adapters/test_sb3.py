"""Stable-Baselines3 trains on the races. It brings PyTorch, so it is no dependency: `make sb3` installs both."""

import os
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: `make sb3` installs it")

from stable_baselines3.common.env_checker import check_env

from cruise.adapters.gymnasium_env import RaceEnv
from cruise.adapters.gymnasium_vector import VectorRaceEnv
from cruise.adapters.sb3 import StableBaselinesEnv

EXAMPLE = Path(__file__).parents[2] / "examples" / "train_sb3.py"
DUEL = {"track": "ring", "opponents": ["chaser"], "episode_steps": 9}


@pytest.mark.filterwarnings("error")
def test_its_own_check():
    check_env(RaceEnv(**DUEL))


def test_it_sees_what_gymnasium_sees():
    ours, theirs = VectorRaceEnv(3, autoreset_mode="SameStep", **DUEL), StableBaselinesEnv(3, **DUEL)
    theirs.seed(7)
    np.testing.assert_array_equal(theirs.reset(), ours.reset(seed=7)[0])
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(20):
        action = rng.uniform(-1, 1, (3, 3)).astype(np.float32)
        seen, reward, done, told = theirs.step(action)
        observation, gain, terminated, truncated, infos = ours.step(action)
        np.testing.assert_array_equal(seen, observation)
        np.testing.assert_array_equal(reward, gain)
        np.testing.assert_array_equal(done, terminated | truncated)
        for race in np.flatnonzero(done):
            ends += 1
            np.testing.assert_array_equal(told[race]["terminal_observation"], infos["final_obs"][race])
            assert told[race]["TimeLimit.truncated"] == truncated[race]
        assert all(not one for race, one in enumerate(told) if not done[race])
    assert ends >= 6


def test_the_example_trains_and_measures_in_one_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "environ", os.environ.copy())
    flags = ["--steps", "2048", "--races", "8", "--episodes", "3", "--drones", "2", "--opponent", "chaser"]
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), *flags])
    monkeypatch.setattr(sys, "path", [str(EXAMPLE.parent), *sys.path])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    text = capsys.readouterr().out
    assert "success " in text
    assert "PILOT_MODEL=runs/sb3/model.zip cruise evaluate --track ring --drones 2 --pilot " in text
    assert (tmp_path / "runs" / "sb3" / "model.zip").is_file()


def test_options_of_a_reset_are_heeded_and_those_of_the_race_told():
    env = StableBaselinesEnv(2, **DUEL, render_mode="rgb_array")
    assert env.get_attr("render_mode") == ["rgb_array"] * 2
    assert env.get_attr("track", [0]) == ["ring"]
    assert env.get_attr("opponents") == [["chaser"]] * 2
    places = np.array([[2.0, 1.0, 1.5], [2.0, 4.0, 1.5]])
    env.set_options([{"start": {"position_w": places + race, "gate": race}} for race in range(2)])
    env.seed(1)
    env.reset()
    stands = np.asarray(env.env._races.state.drones.position_w).T
    np.testing.assert_allclose(stands, np.stack([places, places + 1]).astype(np.float32), atol=1e-6)
    assert [image.shape for image in env.get_images()] == [(480, 640, 3)] * 2
    env.reset()
    assert not np.allclose(np.asarray(env.env._races.state.drones.position_w).T, stands)
