"""A user's own observation and reward term: one update of training, the policy's file, a race, an adapter, a resume."""

import numpy as np
import pytest

from cruise.cli.main import main
from cruise.env.observation import OBSERVATIONS
from cruise.env.payment import REWARD_TERMS
from cruise.errors import CruiseError
from cruise.evaluation.matches import race_env
from cruise.pilots.terms_file import load_terms
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.policy_file import load_policy, read_meta
from cruise.training.metrics_log import read_metrics
from tests.helpers import terms_forgotten
from tests.training.runs import TINY_FLAGS

TERMS = """
import jax.numpy as jnp
from cruise import RewardTerm, Term, find_observation

def own_speed(view):
    return jnp.sqrt((view.velocity_w**2).sum(axis=0))

speed = Term("own_speed", 1, "own speed", "m/s", {scale}, low=0.0, fn=own_speed)
OBSERVATIONS = [find_observation("{base}").with_terms("informed", speed)]
REWARDS = [RewardTerm("effort", "interaction", -0.01, lambda step: (step.action**2).sum(axis=0))]
"""


@pytest.fixture(autouse=True)
def _forgotten():
    with terms_forgotten():
        yield


def written(folder, base="extended", scale=10.0, name="mine.py"):
    path = folder / name
    path.write_text(TERMS.format(base=base, scale=scale))
    return path


def forget():
    OBSERVATIONS.pop("informed", None)
    REWARD_TERMS.pop("effort", None)


@pytest.mark.parametrize("vehicle", ["paper", "racer"])
def test_trains_flies_and_is_written_down(vehicle, tmp_path, capsys):
    file, run = written(tmp_path, "extended" if vehicle == "paper" else "body"), tmp_path / "run"
    flags = [{"0.0012": "0.00003" if vehicle == "paper" else "0.00015"}.get(flag, flag) for flag in TINY_FLAGS]
    flags += ["--episodes", "1", "--vehicle", vehicle, "--out", str(run)]
    flags += ["--terms", str(file), "--observation", "informed", "--randomise", "0"]
    assert main(["train", *flags]) == 0
    meta = read_meta(run)
    assert (meta.observation, meta.config["reward_terms"]) == ("informed", ["effort"])
    assert meta.layout[-1].name == "own_speed"
    assert sum(entry.size for entry in meta.layout) == load_policy(run).params.actor.layers[0].in_features
    assert all(row["reward/effort"] < 0 for row in read_metrics(run))

    race = ["race", "--policy", str(run), "--laps", "1", "--html", "None", "--png", str(tmp_path / "race.png")]
    assert main([*race, "--terms", str(file)]) == 0

    forget()
    capsys.readouterr()
    assert main(race) == 2
    assert "--terms" in capsys.readouterr().err
    assert main(["train", "--resume", str(run)]) == 2
    assert "--terms" in capsys.readouterr().err

    forget()
    assert main([*race, "--terms", str(written(tmp_path, meta_base(meta), 7.0, "other.py"))]) == 2
    assert "scale of its term 'own_speed' was 10.0 and is 7.0 here" in capsys.readouterr().err


def meta_base(meta):
    return "extended" if meta.layout[0].name == "place" else "body"


@pytest.mark.parametrize("vehicle", ["paper", "racer"])
def test_through_gymnasium(vehicle, tmp_path):
    import gymnasium

    import cruise.gym  # noqa: F401  (registers the races)

    file = written(tmp_path, "body")
    field = {"drones": 1} if vehicle == "racer" else {"opponents": ["hover"]}
    race = {"track": "ring", "vehicle": vehicle, **field}
    env = gymnasium.make("cruise/Race-v0", **race, observation="informed", terms=file)
    plain = gymnasium.make("cruise/Race-v0", **race, observation="body")
    assert env.observation_space.shape[0] == plain.observation_space.shape[0] + 1
    assert (env.observation_space.low[-1], env.observation_space.high[-1]) == (0.0, 3.0)
    env.reset(seed=0)
    action = np.full(env.action_space.shape, 0.5, np.float32)
    seen, reward, _, _, info = env.step(action)
    assert seen in env.observation_space
    components = {k.removeprefix("reward_"): v for k, v in info.items() if k.startswith("reward_")}
    assert components["effort"] == pytest.approx(-0.01 * float((action**2).sum()), abs=1e-6)
    assert sum(components.values()) == pytest.approx(reward, abs=1e-5)
    env.close()
    plain.close()


def test_a_file_that_declares_nothing_sensible_is_one_line(tmp_path):
    for text, word in (
        ("x = 1\n", "neither"),
        ("OBSERVATIONS = 3\n", "list"),
        ("REWARDS = [3]\n", "int"),
        ("import nothing_of_this_name\n", "nothing_of_this_name"),
        ("from cruise import Observation, Term\nOBSERVATIONS = [Observation('paper', ())]\n", "own"),
    ):
        path = tmp_path / "bad.py"
        path.write_text(text)
        with pytest.raises(CruiseError, match=word):
            load_terms(path)
    with pytest.raises(CruiseError, match="does not exist"):
        load_terms(tmp_path / "nowhere.py")
    with pytest.raises(CruiseError, match=r"\.py"):
        load_terms(tmp_path)


def test_the_same_file_gives_the_same_terms_and_a_changed_one_others(tmp_path):
    """So that what was compiled for them is found again."""
    path = written(tmp_path)
    first, again = load_terms(path), load_terms(path)
    assert first.observations[0] is again.observations[0]
    path.write_text(path.read_text() + "# changed\n")
    assert load_terms(path).observations[0] is not first.observations[0]


def test_what_is_made_known_after_a_race_is_seen_in_the_next(tmp_path):
    """Environments are kept from race to race; one from before must not stand for what can be observed since."""
    kept = race_env(TRACKS["ring"], 1, VEHICLES["paper"])
    load_terms(written(tmp_path))
    assert "informed" not in kept.observe_as
    assert "informed" in race_env(TRACKS["ring"], 1, VEHICLES["paper"]).observe_as
