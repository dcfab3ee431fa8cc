"""The search for a recipe: what a trial trains, how it goes on, and what Ray Tune makes of it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cruise.config import TrainConfig
from cruise.errors import CruiseError
from cruise.training import tuner
from cruise.training.self_play import Score
from cruise.training.tuner import BEST, RECORD, Tried, best_of, find_recipe, search_space
from cruise.training.tuning import CRASH, HOPELESS, SPACE, Search, Trial, applied, cost_of, usual_settings
from tests.training.runs import TINY

SMALL = replace(TINY, drones=1, step_scale=2 * 64 * 16 / 40e6 * 1.01)  # two updates
SEARCH = Search(SMALL, ("ring",), rungs=2, samples=2)


def test_settings_reach_the_part_that_has_them():
    config = applied(TrainConfig(), {"gae_lambda": 0.9, "terminal": -7.0, "retry_share": 0.5, "sparring_share": 0.3})
    assert (config.ppo.gae_lambda, config.reward.terminal) == (0.9, -7.0)
    assert (config.retry_share, config.opponents.sparring_share) == (0.5, 0.3)
    assert usual_settings(config, ["terminal", "gae_lambda"]) == {"terminal": -7.0, "gae_lambda": 0.9}
    with pytest.raises(CruiseError, match="no field 'gea_lambda' to search"):
        applied(TrainConfig(), {"gea_lambda": 0.9})
    with pytest.raises(CruiseError, match="'races' is not searched; these are: learning_rate"):
        search_space(("races",))
    assert applied(TrainConfig(), usual_settings(TrainConfig(), list(SPACE))) == TrainConfig()


def test_a_lap_and_a_crash_in_a_hundred_are_weighed_by_their_shares():
    score = Score(math.nan, 1.0, 10.0, 4.0)
    assert cost_of(score, 20.0) == pytest.approx(math.log(4.0))
    assert cost_of(score._replace(lap_time=4.08, success=0.99), 20.0) - cost_of(score, 20.0) == pytest.approx(
        math.log(1.02) + 0.01 * CRASH
    )
    hopeless = cost_of(score._replace(lap_time=math.nan, success=0.0), 20.0)
    assert hopeless == pytest.approx(math.log(20.0) + HOPELESS + CRASH)


def test_a_trial_goes_on_where_it_was_saved(tmp_path):
    trial = Trial(SEARCH, {"learning_rate": 2e-3})
    first = trial.advance()
    assert math.isfinite(first["cost"])
    trial.save(tmp_path)
    assert [int(state.updates) for state in trial.states.values()] == [1]
    second = trial.advance()
    trial.states = {name: trainer.initial_state() for name, trainer in trial.trainers.items()}
    trial.load(tmp_path)
    assert trial.rung == 1
    np.testing.assert_equal(trial.advance(), second)


def pretend(settings, search, prepare):
    """In place of training: a lap as long as its learning rate."""
    from ray import tune

    prepare()
    for _ in range(search.rungs):
        tune.report({"cost": settings["learning_rate"], "ring-0/lap": math.nan, "ring-0/success": 1.0})


@pytest.fixture
def started_ray():
    pytest.importorskip("ray.tune")
    import ray

    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, logging_level="ERROR", configure_logging=False)
    yield
    ray.shutdown()


@pytest.mark.usefixtures("started_ray")
def test_ray_tune_keeps_a_record_and_goes_on(tmp_path, monkeypatch):
    """The best first, the defaults among them; a folder holds one search."""
    monkeypatch.setattr(tuner, "try_settings", pretend)
    folder, search = tmp_path / "search", replace(SEARCH, samples=4)
    found = find_recipe(search, folder, ("learning_rate",), nothing, at_once=1)
    rates = [one.settings["learning_rate"] for one in found]
    assert len(set(rates)) == 4
    assert SMALL.ppo.learning_rate in rates
    whole = [one.settings["learning_rate"] for one in found if one.rungs == search.rungs]
    assert whole == sorted(whole)
    assert found[0].told == {"cost": rates[0], "ring-0/success": 1.0}
    lines = [json.loads(line) for line in (folder / RECORD).read_text().splitlines()]
    assert lines == [one._asdict() for one in found]
    assert json.loads((folder / BEST).read_text()) == lines[0]
    with pytest.raises(CruiseError, match="holds a search already"):
        find_recipe(search, folder, (), nothing)
    assert find_recipe(search, folder, (), nothing, resume=True) == found
    with pytest.raises(CruiseError, match="no search to resume here"):
        find_recipe(search, tmp_path / "other", (), nothing, resume=True)


def nothing():
    """In place of what gets a worker ready to train."""


def test_what_is_best_is_told_as_flags():
    tried = Tried({"learning_rate": 2e-3, "gae_lambda": SMALL.ppo.gae_lambda}, 2, {"cost": 1.0})
    assert best_of(SEARCH, [tried]) == "--learning-rate 0.002"
