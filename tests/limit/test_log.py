"""A time-optimal lap as a race log, and the command that writes it."""

import numpy as np
import pytest

from cruise.cli.main import main
from cruise.evaluation.metrics import race_result
from cruise.extras import how_to_install
from cruise.limit.log import limit_log
from cruise.limit.models import POSITION, VELOCITY
from cruise.presets import TRACKS, VEHICLES
from cruise.storage.race_log import EventKind, load_race_log
from tests.limit.test_lap import limit


@pytest.mark.parametrize(("standing", "laps"), [(0, 1), (0, 3), (2, 2)])
def test_a_log_is_sound_and_says_the_times_of_the_lap(standing, laps, tmp_path):
    found = limit(standing_laps=standing)
    limit_log(found, laps).save(tmp_path / "limit.npz")
    log = load_race_log(tmp_path / "limit.npz")
    metrics = race_result(log).drones[0]
    times = found.lap_times if standing else found.lap_times * laps
    np.testing.assert_allclose([metrics.first_lap_time, *metrics.flying_lap_times], times, atol=1e-6)
    assert metrics.finished
    assert log.event_time[log.event_kind == EventKind.FINISH] == pytest.approx(sum(times))
    assert log.laps == laps
    assert log.time[-1] - 0.02 < sum(times) <= log.time[-1]


def test_samples_lie_on_the_line_flown():
    found = limit()
    log = limit_log(found, laps=2)
    nodes = found.lap.clock
    for part, values in ((POSITION, log.position_w), (VELOCITY, log.velocity_w)):
        at_nodes = np.stack([np.interp(nodes, log.time, values[:, 0, i]) for i in range(3)], axis=1)
        np.testing.assert_allclose(at_nodes, found.lap.state[:, part], atol=0.05)
    whole = round(found.lap.time / 0.02)
    assert np.abs(log.position_w[whole, 0] - log.position_w[0, 0]).max() < 0.5  # round again
    turn = np.abs(np.diff(np.unwrap(log.euler[:, 0], axis=0), axis=0)).max()
    assert turn < 0.5  # no jumps of angle


def test_every_crossing_of_the_log_is_one_of_its_line():
    """The line between samples meets the plane of the gate at the time that the event says."""
    found = limit("figure-eight")
    log = limit_log(found)
    for time, gate, kind in zip(log.event_time[1:-1], log.event_gate[1:-1], log.event_kind[1:-1], strict=True):
        assert kind == EventKind.CROSSING
        place = np.array([np.interp(time, log.time, log.position_w[:, 0, i]) for i in range(3)])
        opening = TRACKS["figure-eight"].gates[gate]
        normal = np.array([np.cos(opening.yaw), np.sin(opening.yaw), 0])
        assert abs((place - opening.position_w) @ normal) < 0.05


def test_the_command_prints_the_lap_and_writes_the_log(tmp_path, capsys):
    path = tmp_path / "limit.npz"
    assert main(["limit", "ring", "--vehicle", "racer", "--log", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "ring by racer (four rotors), in periodic flight"
    assert float(lines[1].split()[1]) == pytest.approx(limit().lap.time, abs=1e-3)
    assert sum(map(float, lines[2].split()[1:-1])) == pytest.approx(limit().lap.time, abs=3e-3)
    assert lines[-1] == f"log      {path}"
    assert load_race_log(path).vehicle == VEHICLES["racer"].name


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ("ring --laps 0", "--laps must be between 1 and 10, not 0"),
        ("ring --log limit.csv", "--log must name a .npz file, got 'limit.csv'"),
        ("rnig", "unknown track 'rnig': did you mean 'ring'?"),
        ("ring --vehicle racr", "unknown vehicle 'racr': did you mean 'racer'?"),
        ("ring --vehicle paper --steps 30", "steps are not to be chosen for 'paper': its own are 0.1 s long"),
        (
            "ring --vehicle paper --largest-change 3",
            "largest change of an action must be above 0 and at most 2",
        ),
        ("ring --vehicle paper --largest-change nan", "largest change of an action must be above 0"),
        ("ring --margin nan", "margin must be from 0 to less than 1 m"),
    ],
)
def test_bad_input_is_one_line(flags, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["limit", *flags.split()]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: " + told), error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_without_casadi_the_extra_is_named(monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "casadi", None)
    assert main(["limit", "ring"]) == 2
    assert capsys.readouterr().err == f"error: the limit needs CasADi: {how_to_install('limit')}\n"
