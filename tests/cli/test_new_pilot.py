"""`cruise new-pilot`: what it writes flies at once, alone and among others."""

import json

import pytest

from cruise.cli.main import main
from cruise.storage.race_log import load_race_log


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_the_template_flies_the_ring(tmp_path, capsys):
    assert main(["new-pilot", "my_pilot.py"]) == 0
    assert "cruise race --track ring --pilot my_pilot.py:Pilot" in capsys.readouterr().out
    flags = ["--track", "ring", "--drones", "3", "--pilot", "my_pilot.py:Pilot", "--pilot", "chaser"]
    assert main(["evaluate", *flags, "--episodes", "4", "--seed", "1", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["policy"] == "my pilot,chaser,my pilot"
    assert result["success_rate"]["mean"] == 1.0
    assert 25 < result["flying_lap_time"]["mean"] < 29


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


def test_mixed_with_compiled_pilots_the_same_seed_is_the_same_race(capsys):
    assert main(["new-pilot", "my_pilot.py"]) == 0
    flags = ["--pilot", "my_pilot.py:Pilot", "--pilot", "hover", "--laps", "1", "--seed", "3", "--png", "None"]
    for name in ("one.npz", "two.npz"):
        assert main(["race", *flags, "--log", name]) == 0
    one, two = (load_race_log(name) for name in ("one.npz", "two.npz"))
    assert one.pilots.tolist() == ["my pilot", "hover"]
    assert (one.position_w == two.position_w).all()
    assert len(one.event_time) >= 6


@pytest.mark.parametrize(
    ("flags", "message"),
    [(["pilot.txt"], "a pilot is a .py file, got 'pilot.txt'"), (["there.py"], "there.py exists already")],
)
def test_bad_names(flags, message, tmp_path, capsys):
    (tmp_path / "there.py").write_text("mine")
    assert main(["new-pilot", *flags]) == 2
    assert message in capsys.readouterr().err
    assert (tmp_path / "there.py").read_text() == "mine"
