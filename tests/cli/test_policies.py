"""`cruise policies` lists what is shipped."""

import pytest

from cruise.cli.main import main
from cruise.storage import policy_file, policy_paths
from tests.storage.policies import write_policy


@pytest.fixture
def shipped(tmp_path, monkeypatch):
    monkeypatch.setattr(policy_paths, "SHIPPED", tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    return tmp_path


def test_lists_names_and_provenance(shipped, capsys):
    measured = {"success_rate": {"mean": 0.985}, "flying_lap_time": {"mean": 13.25}, "mean_speed": {"mean": 4.5}}
    write_policy(shipped / "ring-2", steps=40_000_000, seed=12, results=measured)
    write_policy(shipped / "figure-eight-2", track="figure-eight", results={"flying_lap_time": {"mean": None}})
    assert main(["policies"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if "-2" in line]
    assert ["figure-eight-2" in rows[0], "ring-2" in rows[1]] == [True, True]
    for text in ("40.0 M", "12", "98.5 %", "13.25 s", "4.50 m/s", "0.1.0"):
        assert text in rows[1]
    assert rows[0].count(" - ") == 3


def test_long_names_are_whole_in_a_narrow_terminal(shipped, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    write_policy(shipped / "racer-figure-eight-sturdy", results={"mean_speed": {"mean": 12.13}})
    assert main(["policies"]) == 0
    assert "racer-figure-eight-sturdy" in capsys.readouterr().out


def test_says_when_there_are_none(shipped, capsys):
    assert main(["policies"]) == 0
    assert "no policies are shipped" in capsys.readouterr().out


def test_a_damaged_one_is_named(shipped, capsys):
    write_policy(shipped / "ring-2")
    (shipped / "ring-2.json").write_text("{")
    assert main(["policies"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: policy description")
    assert error.count("\n") == 1


def test_what_this_installation_ships(capsys):
    assert main(["policies"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in policy_file.list_policies())
