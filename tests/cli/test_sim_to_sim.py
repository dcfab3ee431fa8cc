"""`cruise sim-to-sim`: the same races in every simulator there is."""

import json

import pytest

from cruise.cli.main import main
from cruise.interop import simulators

FLIGHT = ["sim-to-sim", "--track", "ring", "--pilot", "chaser", "--drones", "1", "--vehicle", "racer"]


@pytest.fixture(autouse=True)
def without_slow_simulators(monkeypatch):
    """MuJoCo alone stands for all of them here."""
    monkeypatch.setattr("cruise.evaluation.sim_to_sim.is_installed", lambda name: name == "mujoco")


def test_table_and_json_say_the_same(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    assert main([*FLIGHT, "--episodes", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert list(found) == ["cruise", *simulators.SIMULATORS]
    assert found["rotorpy"] is None
    laps = [found[name]["flying_lap_time"]["mean"] for name in ("cruise", "mujoco")]
    assert found["mujoco"]["success_rate"]["mean"] == 1.0
    assert laps[1] == pytest.approx(laps[0], rel=0.05)
    assert laps[0] != laps[1]
    assert main([*FLIGHT, "--episodes", "2"]) == 0
    text = capsys.readouterr().out
    for words in (f"{laps[0]:.2f}", f"{laps[1]:.2f}", "not installed: pip install 'rotorpy>="):
        assert words in text


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["--simulator", "mujoco"], "sim-to-sim flies in all simulators: leave out --simulator"),
        (["--vehicle", "paper"], "fly vehicles by thrust and body rates, and 'paper' is not flown so"),
    ],
)
def test_bad_flags_get_one_line(flags, complaint, capsys):
    aboard = FLIGHT[:-2] if "--vehicle" in flags else FLIGHT  # a vehicle more would be another drone's
    assert main([*aboard, *flags]) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1
