"""Named protocols: their starts, their measures on logs made by hand, and the command."""

import dataclasses
import json
import math

import numpy as np
import pytest

from cruise.cli.main import main
from cruise.evaluation import protocols
from cruise.evaluation.measures import MEASURES, Outcome, measured, passed_at_gates
from cruise.evaluation.protocols import PROTOCOLS
from cruise.presets import TRACKS
from tests.storage.logs import crossing_log

UZH, TRACK = PROTOCOLS["uzh"], TRACKS["uzh-2026"]


def test_drones_of_a_race_are_displaced_alike_within_the_grid():
    """64 starts, a metre of arc apart on the circle around gate 1, both ways from the first place where N > 4."""
    centre = np.array(TRACK.gates[0].position_w)
    for drones, first in ((4, 0.0), (8, -2.0), (5, -0.5)):
        position, heading = UZH.grid.places(TRACK, drones)
        assert (position.shape, heading.shape) == ((3, drones, 64), (drones, 64))
        middle = position.mean(axis=2).T
        radius = np.linalg.norm(middle[:, :2] - centre[:2], axis=1)
        np.testing.assert_allclose(radius, math.hypot(-5.0 + 0.6, 4.7 + 0.86), rtol=1e-6)
        turn = np.unwrap(np.arctan2(middle[:, 1] - centre[1], middle[:, 0] - centre[0]))
        np.testing.assert_allclose(np.diff(turn) * radius[0], 1.0, rtol=1e-6)
        nominal = math.atan2(4.7 + 0.86, -5.0 + 0.6)
        assert (turn[0] - nominal) * radius[0] == pytest.approx(first, abs=1e-6)
        offset = position - position.mean(axis=2, keepdims=True)
        reach = np.linalg.norm(offset[:2], axis=0)
        np.testing.assert_allclose(reach, np.repeat(reach[:1], drones, axis=0), atol=1e-9)
        assert reach.max() == pytest.approx(0.33 * math.sqrt(2))
        assert offset[2].max() == pytest.approx(0.2)
        assert len({tuple(row) for row in position[:, 0].T.round(6).tolist()}) == 64


def race(times):
    return Outcome.of(crossing_log(np.array(times)))


def test_overtakes_count_where_passages_can_be_told_apart():
    """Steps of 0.1 s: drone 1 passes at crossing 2; at crossing 3 the two are too close together to tell."""
    assert passed_at_gates(crossing_log(np.array([[0.1, 1.0, 2.0], [0.5, 1.5, 1.65]]))) == (0, 1)
    assert passed_at_gates(crossing_log(np.array([[0.1, 1.0, 2.0], [0.5, 1.5, 1.95]]))) == (0, 0)
    # who does not reach a gate is not overtaken there
    assert passed_at_gates(crossing_log(np.array([[0.1, np.nan], [0.5, 1.0], [0.9, 2.0]]))) == (0, 0, 0)


def test_measures_of_a_race():
    """Three gates, two laps: seven passages. Laps count from a passage of the first gate to the next one."""
    one = race([[0.2, 1.0, 2.0, 3.2, 4.0, 5.0, 5.7], [0.6, 1.5, 2.5, 3.8, np.nan, np.nan, np.nan]])
    of = {name: [MEASURES[name].of(one, drone) for drone in range(2)] for name in ("gates", "best_lap", "rank")}
    assert of["gates"] == [1.0, pytest.approx(4 / 7)]
    assert of["best_lap"] == [pytest.approx(2.5), pytest.approx(3.2)]
    assert of["rank"] == [1.0, 2.0]
    assert measured("gates", [one]).mean == pytest.approx((1 + 4 / 7) / 2)
    assert measured("gates", [one], "pilot 1").mean == pytest.approx(4 / 7)
    assert math.isnan(measured("time", [one]).mean)


def test_a_race_that_ends_at_the_last_gate_counts_each_of_its_gates_once():
    assert (TRACKS["lsy-2"].gates_to_finish(1), TRACK.gates_to_finish(3)) == (4, 22)
    log = dataclasses.replace(crossing_log(np.array([[0.2, 1.0, 2.0]])), laps=1, finish="last")
    assert log.gates_to_finish == 3
    assert MEASURES["gates"].of(Outcome.of(log), 0) == 1.0


def test_a_field_and_line_ups_are_flown_and_told(monkeypatch, capsys):
    """Two starts of the 64, of a scripted pilot in the paper's vehicle, which is slow: half a lap in 12 s."""
    monkeypatch.setitem(protocols.PROTOCOLS, "uzh", dataclasses.replace(UZH, time_limit=12.0))
    flags = ["evaluate", "--protocol", "uzh", "--vehicle", "paper", "--episodes", "2", "--json"]
    assert main([*flags, "--pilot", "chaser", "--drones", "2"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert (row["track"], row["drones"], row["pilot"], row["races"]) == ("uzh-2026", 2, "chaser", 2)
    assert list(row["measures"]) == list(UZH.measures)
    assert 0 < row["measures"]["gates"]["mean"] < 1
    assert main([*flags, "--pool", "chaser", "--pool", "hover", "--line-ups", "3"]) == 0
    rows = {row["pilot"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert set(rows) == {"chaser", "hover"}
    assert rows["hover"]["measures"]["gates"]["mean"] == 0 < rows["chaser"]["measures"]["gates"]["mean"]
    assert rows["chaser"]["measures"]["rank"]["mean"] < rows["hover"]["measures"]["rank"]["mean"]


def test_munichs_protocol_tells_of_what_is_near_alone_unless_asked_otherwise(monkeypatch, capsys):
    flown = []
    monkeypatch.setattr("cruise.evaluation.protocol_races.fly_field", lambda match, *_: flown.append(match) or [])
    for flags in ([], ["--sensing", "camera"]):
        assert main(["evaluate", "--protocol", "lsy", "--vehicle", "racer", "--pilot", "hover", *flags, "--json"]) == 0
    near, seen = (match.sensing for match in flown)
    assert (near.sensing, near.sensor_range, near.fix_error) == ("range", 0.7, 0.0)
    assert seen.sensing == "camera"
    assert {match.randomisation.solid_shift for match in flown} == {0.15}


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--protocol", "nasa"], "unknown protocol 'nasa': there are paper, uzh, lsy"),
        (
            ["--protocol", "uzh", "--pilot", "chaser", "--drones", "9"],
            "protocol uzh races 1, 2, 3, 4, 5, 6, 7, 8 drones",
        ),
        (["--protocol", "paper", "--pilot", "chaser", "--track", "split-s"], "protocol paper races 2, 3, 4 drones on"),
        (["--protocol", "uzh", "--episodes", "65"], "protocol uzh has from 1 to 64 races of a field, not 65"),
        (["--protocol", "uzh", "--html", "races.html"], "--html shows races of one match"),
        (["--protocol", "uzh", "--line-ups", "3"], "--line-ups are drawn out of a pool: give --pool NAME"),
        (["--protocol", "uzh", "--pool", "chaser", "--drones", "2"], "--pool says who races"),
        (["--protocol", "lsy", "--pool", "chaser"], "protocol lsy has no line-ups out of a pool"),
        (["--pool", "chaser"], "--pool and --line-ups belong to a protocol"),
    ],
)
def test_bad_flags_give_one_line(flags, message, capsys):
    assert main(["evaluate", *flags]) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.err.count("\n") == 1
