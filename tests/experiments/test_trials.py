"""Trials: what makes each, as flags that differ from today's defaults, and what came of it."""

import math
from dataclasses import replace

import pytest

from cruise.errors import CruiseError
from cruise.presets import training_config
from experiments.trials import read_trials, trial_table
from tests.storage.policies import write_policy

FOUND = {
    name: {"mean": mean} for name, mean in (("success_rate", 0.985), ("mean_speed", 4.4), ("flying_lap_time", 13.3))
}


def write_trial(folder, name, seed=0, results=FOUND, **changes):
    """A trial of two drones on the ring whose training differed from the usual by `changes`."""
    config = replace(training_config(drones=2), seed=seed, **changes)
    path = write_policy(folder / "trials" / name, seed=seed, config=config, results=results)
    path.unlink()  # its parameters are not kept


def test_rows_name_what_makes_them_and_stand_beside_their_like(tmp_path):
    (tmp_path / "trials").mkdir()
    write_trial(tmp_path, "a", seed=1)
    write_trial(tmp_path, "b", episode_steps=100)
    write_trial(tmp_path, "c", seed=0)
    table = trial_table(read_trials(tmp_path))
    usual = "cruise train --track ring --drones 2 --seed"
    assert [row[1] for row in table.rows] == [f"{usual} 0", f"{usual} 1", f"{usual} 0 --episode-steps 100"]
    assert [entry if isinstance(entry, str) else entry.text for entry in table.rows[0]] == [
        "2",
        f"{usual} 0",
        "98.5",
        "4.40",
        "13.30",
    ]


def test_where_nobody_finished_there_is_a_dash(tmp_path):
    (tmp_path / "trials").mkdir()
    write_trial(tmp_path, "a", results=FOUND | {"mean_speed": {"mean": None}})
    assert trial_table(read_trials(tmp_path)).rows[0][3].text == "-"
    assert math.isnan(trial_table(read_trials(tmp_path)).rows[0][3].mean)


def test_a_folder_without_trials_has_none(tmp_path):
    assert read_trials(tmp_path) == ()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ({"results": {}}, "trial test: results lack success_rate, mean_speed or flying_lap_time"),
        ({"results": FOUND | {"mean_speed": 4.4}}, "trial test: results lack"),
    ],
)
def test_a_trial_that_measured_nothing_is_refused(spoil, said, tmp_path):
    (tmp_path / "trials").mkdir()
    write_trial(tmp_path, "a", **spoil)
    with pytest.raises(CruiseError, match=said):
        trial_table(read_trials(tmp_path))


def test_a_damaged_trial_is_named(tmp_path):
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / "a.json").write_text("{")
    with pytest.raises(CruiseError, match=r"a\.json: not valid JSON"):
        read_trials(tmp_path)
