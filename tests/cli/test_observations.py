"""`cruise observations` lists what there is, and every number of one."""

import pytest

from cruise.cli.main import main
from cruise.dynamics import make_dynamics
from cruise.env.observation import OBSERVATIONS, find_observation
from cruise.env.term_tables import observation_size
from cruise.presets import TRACKS
from cruise.terms import Setting
from cruise.vehicles import load_vehicle


def rows(text):
    """Cells of a table in Markdown, without its head."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]


@pytest.mark.parametrize("vehicle", ["paper", "racer", "own.toml"])
def test_all_are_listed_with_their_sizes(vehicle, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.toml").write_text('name = "own"\nbase = "racer"\ncontrol = "velocity"\n')
    assert main(["observations", "--vehicle", vehicle, "--drones", "3", "--track", "figure-eight"]) == 0
    setting = Setting(3, len(TRACKS["figure-eight"].gates), make_dynamics(load_vehicle(vehicle)))
    listed = {name: int(size) for name, size, _ in rows(capsys.readouterr().out)}
    assert listed == {name: observation_size(one, setting) for name, one in OBSERVATIONS.items()}


def test_one_is_told_number_by_number(capsys):
    assert main(["observations", "extended", "--drones", "2"]) == 0
    table = capsys.readouterr().out
    setting = Setting(2, len(TRACKS["ring"].gates), make_dynamics(load_vehicle("paper")))
    assert all(term.name in table for term in find_observation("extended").terms_for(setting))


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["extnded"], "unknown observation 'extnded'"),
        (["--drones", "0"], "--drones must be from 1 to 64, got 0"),
        (["--vehicle", "racr"], "unknown vehicle 'racr': did you mean 'racer'?"),
        (["--track", "rink"], "unknown track 'rink'"),
        (["--terms", "none.py"], "none.py"),
    ],
)
def test_bad_input_gives_one_line(flags, message, capsys):
    assert main(["observations", *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert error.count("\n") == 1
