"""`cruise new-pilot`: what it writes flies at once, alone and among others."""

import pytest

from cruise.cli.main import main
from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.metrics import race_result
from cruise.presets import TRACKS


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_the_template_flies_the_ring(tmp_path, capsys):
    assert main(["new-pilot", "my_pilot.py"]) == 0
    assert "cruise race --track ring --pilot my_pilot.py:Pilot" in capsys.readouterr().out
    match = make_match(TRACKS["ring"], 3, ["my_pilot.py:Pilot", "chaser"], laps=1)
    assert [pilot.name for pilot in match.team] == ["my pilot", "chaser", "my pilot"]
    logs = list(run_races(match, 4, seed=1))
    assert all(drone.finished for log in logs for drone in race_result(log).drones)
    for log, again in zip(logs, run_races(match, 4, seed=1), strict=True):
        assert (log.position_w == again.position_w).all()


def test_a_pilot_that_fails_ends_the_race_with_one_line_and_no_files(tmp_path, capsys):
    (tmp_path / "bad.py").write_text(
        "def slow(view):\n    import time\n    time.sleep(0.05)\n\nnothing = lambda view: 0\n"
    )
    for name, flags, message in (
        ("slow", ["--budget-ms", "10"], "was not done within its budget of 10 ms"),
        ("nothing", [], "gave an array of shape [], expected 3 finite numbers in [-1, 1]"),
        ("slow", ["--budget-ms", "-1"], "the time budget of a pilot must be above 0"),
    ):
        assert main(["race", "--drones", "2", "--pilot", f"bad.py:{name}", "--log", "race.npz", *flags]) == 2
        output = capsys.readouterr()
        assert message in output.err
        assert output.err.count("\n") == 1
        assert output.out == ""
    assert [path.name for path in tmp_path.iterdir() if path.name != "__pycache__"] == ["bad.py"]


@pytest.mark.parametrize(
    ("flags", "message"),
    [(["pilot.txt"], "a pilot is a .py file, got 'pilot.txt'"), (["there.py"], "there.py exists already")],
)
def test_bad_names(flags, message, tmp_path, capsys):
    (tmp_path / "there.py").write_text("mine")
    assert main(["new-pilot", *flags]) == 2
    assert message in capsys.readouterr().err
    assert (tmp_path / "there.py").read_text() == "mine"
