"""`cruise evaluate`: one JSON object with exactly the promised keys, or a table."""

import json

import pytest

from cruise.cli import evaluate
from cruise.cli.main import main
from cruise.evaluation.summary import MEASURED
from cruise.storage import policy_paths
from tests.storage.policies import write_policy

KEYS = [
    "track",
    "drones",
    "policy",
    "episodes",
    "seed",
    "success_rate",
    "all_success_rate",
    "flying_lap_time",
    "winner_lap_time",
    "first_lap_time",
    "nominal_lap_time",
    "mean_speed",
    "top_speed",
    "collisions_per_race",
    "missed_gates_per_race",
    "overtakes_per_race",
]
MIXED = ["--track", "ring", "--pilot", "chaser", "--pilot", "hover", "--episodes", "3", "--seed", "5"]


def test_json_is_one_object_with_these_keys(capsys):
    assert main(["evaluate", *MIXED, "--json"]) == 0
    output = capsys.readouterr()
    found = json.loads(output.out, parse_constant=pytest.fail)
    assert output.err == ""
    assert list(found) == KEYS
    assert KEYS[5:] == list(MEASURED)
    assert [found[key] for key in KEYS[:5]] == ["ring", 2, "chaser,hover", 3, 5]
    for key in MEASURED:
        assert list(found[key]) == ["mean", "std", "low", "high"]
    assert found["success_rate"]["mean"] == 0.5
    assert 25 < found["flying_lap_time"]["mean"] < 29


def test_table_shows_everything_measured(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    assert main(["evaluate", *MIXED]) == 0
    text = capsys.readouterr().out
    for words in ("success, per drone", "flying lap", "overtakes", "gate frame", "ground", "won %", "chaser", "hover"):
        assert words in text


def test_replay_steps_through_the_races(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(evaluate, "MOST_SHOWN", 2)
    assert main(["evaluate", *MIXED, "--html", str(tmp_path / "races.html")]) == 0
    assert (tmp_path / "races.html").read_bytes().count(b'"label":"race ') == 2
    assert f"replay   {tmp_path / 'races.html'}\n" in capsys.readouterr().out
    assert main(["evaluate", *MIXED, "--html", "races.txt"]) == 2
    assert "--html must name a .html file" in capsys.readouterr().err


def test_the_shipped_policy_is_the_default(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(policy_paths, "SHIPPED", tmp_path)
    write_policy(tmp_path / "ring-2")
    assert main(["evaluate", "--track", "ring", "--drones", "2", "--episodes", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["policy"] == "ring-2"


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--pilot", "chaser", "--episodes", "0"], "number of races must be from 1"),
        (["--pilot", "chaser", "--seed", "-3"], "seed must be from 0"),
        (["--pilot", "chaser", "--drones", "-1"], "drones must be from 1 to 64"),
        (["--drones", "1", "--pilot", "chaser", "--pilot", "hover"], "2 pilots for 1 drones"),
        (["--policy", "nowhere/policy.safetensors"], "not found"),
    ],
)
def test_bad_flags_give_one_line(flags, message, capsys):
    assert main(["evaluate", *flags, "--json"]) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.err.count("\n") == 1
    assert output.out == ""
