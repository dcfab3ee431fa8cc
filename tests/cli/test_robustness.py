"""`cruise robustness`: a table, a figure and JSON of the same races."""

import json

import pytest

from cruise.cli.main import main
from cruise.evaluation.robustness import cells, sensing_cells
from cruise.presets import RANDOMISATION

PAPER = ["robustness", "--track", "ring", "--pilot", "chaser", "--drones", "1", "--episodes", "1", "--seed", "2"]


def test_table_and_figure(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    assert main([*PAPER, "--png", str(tmp_path / "r.png")]) == 0
    text = capsys.readouterr().out
    assert "chaser (paper) on ring: 1 drone, 1 race each" in text
    for row in ("nothing", "gates shifted and turned, up to", "sensors wrong, position by", "everything at once"):
        assert row in text
    assert "mass" not in text  # the paper's vehicle has none to be wrong about
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")


def test_json_has_every_cell(capsys):
    assert main([*PAPER, "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    table = (*cells(RANDOMISATION["paper"]), *sensing_cells(RANDOMISATION["paper"], 1))
    assert [row["strength"] for row in found] == [cell.strength for cell in table]
    assert {row["unit"] for row in found[1:]} == {"m", "of full", "m/s", "ms"}
    assert found[0]["success_rate"]["mean"] == 1.0
    assert found[0]["flying_lap_time"]["mean"] == pytest.approx(27, abs=2)


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["--randomise", "1"], "robustness goes through all strengths by itself: leave out --randomise"),
        (["--simulator", "mujoco"], "other simulators do not know what robustness changes: leave out --simulator"),
        (["--png", "r.jpg"], "--png"),
        (["--episodes", "0"], "races must be from 1 to 10000, got 0"),
    ],
)
def test_bad_flags_get_one_line(flags, complaint, capsys):
    assert main([*PAPER, *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert complaint in error
    assert error.count("\n") == 1
