"""`cruise tune-planner` writes what it found and says how it went; nothing where something is wrong."""

import json

import pytest

from cruise.cli.main import main
from cruise.evaluation import planner_search
from cruise.pilots.se_ibr.settings import read_tuned


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def quickly(monkeypatch):
    """Scores without races: the slower the better."""

    def measure(track, drones, styles, races, seed, vehicle):
        return [planner_search.Score(1.0, style.speed, style.speed) for style in styles]

    monkeypatch.setattr(planner_search, "measure", measure)


@pytest.mark.usefixtures("quickly")
def test_writes_what_it_found_and_keeps_what_was_there(tmp_path, capsys):
    assert main(["tune-planner", "--quick", "--out", "found.json"]) == 0
    output = capsys.readouterr().out
    assert "tuning SE-IBR on ring with paper: 5 stages" in output
    assert "5/5" in output
    assert "N=4 success 100.0 %" in output
    assert main(["tune-planner", "--quick", "--out", "found.json", "--track", "figure-eight", "--seed", "3"]) == 0
    styles = read_tuned(tmp_path / "found.json")
    assert styles.keys() == {"ring", "figure-eight"}
    assert styles["ring"].speed < 3.0
    entry = json.loads((tmp_path / "found.json").read_text())["tracks"]["figure-eight"]
    assert entry["measured"].keys() == {"2", "3", "4"}
    assert (entry["seed"], entry["races"]) == (3, 12)


@pytest.mark.usefixtures("quickly")
def test_another_vehicle_has_a_file_of_its_own(tmp_path, capsys):
    assert main(["tune-planner", "--quick", "--vehicle", "racer", "--out", "found.json"]) == 0
    entry = json.loads((tmp_path / "found.json").read_text())["tracks"]["ring"]
    assert entry["vehicle"] == "racer"
    assert 5 < entry["style"]["speed"] < 15
    assert main(["tune-planner", "--quick", "--out", "found.json"]) == 2
    assert "found.json is of vehicle 'racer', not 'paper': give another file with --out" in capsys.readouterr().err


@pytest.mark.usefixtures("quickly")
@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--track", "rink"], "unknown track 'rink'"),
        (["--vehicle", "racr"], "unknown vehicle 'racr': did you mean 'racer'?"),
        (["--out", "other.json"], "other.json is no file of `cruise tune-planner`"),
        (["--out", "folder"], "folder is no file of `cruise tune-planner`"),
        (["--seed", "-1"], "seed must be from 0"),
    ],
)
def test_bad_input_gives_one_line_and_no_file(flags, message, tmp_path, capsys):
    (tmp_path / "other.json").write_text('{"colour": "red"}')
    (tmp_path / "folder").mkdir()
    assert main(["tune-planner", "--quick", *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert error.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "other.json"]
    assert (tmp_path / "other.json").read_text() == '{"colour": "red"}'
