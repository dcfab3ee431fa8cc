"""Events and measures of race logs against an independent recomputation from the documentation."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from cruise.config import Pole, Wall
from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.metrics import crash_times, crossing_times, lap_length, overtakes, race_result
from cruise.evaluation.summary import MEASURED, summarise
from cruise.presets import TRACKS
from cruise.racing.random_track import random_tracks
from cruise.racing.track_geometry import lap_length as track_length
from cruise.storage.race_log import COLLISIONS, EVENT_KINDS, load_race_log
from tests.evaluation import reference
from tests.evaluation.pilots import TROUBLE
from tests.storage.logs import crossing_log

RACES = 10
WALLS = (Wall((-9.0, -3.5, 0.5), (0.3, 0.3, 0.6)), Wall((-8.5, -3.2, 0.5), (0.6, 0.6, 1.5), yaw=0.5))
OBSTACLES = (Pole((3.0, 7.0, 0.0), 4.0, 0.3), *WALLS)  # beside the line
TRACK = dataclasses.replace(TRACKS["figure-eight"], obstacles=OBSTACLES)


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """Race logs on disk, full of incidents."""
    folder = tmp_path_factory.mktemp("logs")
    match = make_match(TRACK, 6, TROUBLE, laps=2)
    for number, log in enumerate(run_races(match, RACES, seed=0)):
        log.save(folder / f"{number}.npz")
    return sorted(folder.iterdir())


@pytest.fixture(scope="module")
def measured(paths):
    """The same races, recomputed."""
    return [reference.measure(reference.read(path)) for path in paths]


def test_every_kind_of_event_occurs(paths):
    logs = [reference.read(path) for path in paths]
    assert {name for log in logs for name in log["event_kind_names"][log["event_kind"]]} == set(EVENT_KINDS)


def identity(event):
    """Kind, drone, time."""
    return tuple(event[:3])


def test_events_are_those_of_the_positions(paths, measured):
    for path, again in zip(paths, measured, strict=True):
        log, expected = reference.read(path), again["events"]
        np.testing.assert_array_equal(log["airborne"], again["airborne"])
        names = log["event_kind_names"][log["event_kind"]]
        mine = zip(names, *(log[f"event_{x}"] for x in ("drone", "time", "gate", "other")), strict=True)
        pairs = zip(sorted(mine, key=identity), sorted(expected, key=identity), strict=True)
        for (kind, drone, time, gate, other), theirs in pairs:
            assert (kind, drone, gate, other) == (*theirs[:2], *theirs[3:])
            assert time == pytest.approx(theirs[2], abs=2e-4)


def test_measures_are_those_of_the_documentation(paths, measured):
    for path, expected in zip(paths, measured, strict=True):
        result = race_result(load_race_log(path))
        drones = result.drones
        assert [drone.finished for drone in drones] == expected["finished"]
        close = {"abs": 1e-4, "nan_ok": True}
        assert [drone.finish_time for drone in drones] == pytest.approx(expected["finish_time"], **close)
        assert [drone.first_lap_time for drone in drones] == pytest.approx(expected["first_lap"], **close)
        for drone, laps in zip(drones, expected["flying_laps"], strict=True):
            assert drone.flying_lap_times == pytest.approx(laps, abs=1e-4)
        assert [drone.mean_speed for drone in drones] == pytest.approx(expected["mean_speed"])
        assert [drone.top_speed for drone in drones] == pytest.approx(expected["top_speed"])
        assert sum(drone.missed_gates for drone in drones) == expected["missed"]
        assert {kind: n for kind, n in result.collisions.items() if n} == expected["collisions"]
        assert result.overtakes == expected["overtakes"]
        assert result.winner == expected["winner"]


def test_evaluation_is_the_mean_over_races(paths, measured):
    logs = [load_race_log(path) for path in paths]
    team = logs[0].pilots.tolist()
    evaluation = summarise(TRACK, team, [race_result(log) for log in logs], seed=0)

    def mean(quantity):
        """Over the finishers of each race, then over the races that have one."""
        races = [[quantity(m, d) for d, done in enumerate(m["finished"]) if done] for m in measured]
        return np.mean([np.mean(values) for values in races if values])

    speeds = [
        np.mean([m["mean_speed"][d] for d in np.flatnonzero(m["finished"])]) for m in measured if any(m["finished"])
    ]
    expected = {
        "success_rate": np.mean([m["finished"] for m in measured]),
        "all_success_rate": np.mean([all(m["finished"]) for m in measured]),
        "first_lap_time": mean(lambda m, d: m["first_lap"][d]),
        "flying_lap_time": mean(lambda m, d: np.mean(m["flying_laps"][d])),
        "winner_lap_time": np.mean([np.mean(m["flying_laps"][m["winner"]]) for m in measured if m["winner"] >= 0]),
        "nominal_lap_time": np.mean([measured[0]["lap_length"] / speed for speed in speeds]),
        "mean_speed": np.mean(speeds),
        "top_speed": mean(lambda m, d: m["top_speed"][d]),
        "collisions_per_race": np.mean([sum(m["collisions"].values()) for m in measured]),
        "missed_gates_per_race": np.mean([m["missed"] for m in measured]),
        "overtakes_per_race": np.mean([m["overtakes"] for m in measured]),
    }
    assert set(expected) == set(MEASURED)
    for name, value in expected.items():
        assert getattr(evaluation, name).mean == pytest.approx(value, abs=1e-4), name
    for kind in COLLISIONS:
        counts = [m["collisions"].get(kind, 0) for m in measured]
        assert evaluation.collisions_by_kind[kind].mean == pytest.approx(np.mean(counts))
    assert evaluation.policy == ",".join(team)
    by_name = {pilot.name: pilot for pilot in evaluation.pilots}
    assert by_name["racer"].drones == 2
    assert by_name["racer"].success_rate.mean == np.mean([[m["finished"][d] for d in (0, 2)] for m in measured])
    assert by_name["chaser"].win_rate.mean == np.mean([m["winner"] == 1 for m in measured])


def test_ranking_and_fates(paths):
    for path in paths:
        result = race_result(load_race_log(path))
        assert sorted(result.ranking) == list(range(6))
        ranked = [result.drones[drone] for drone in result.ranking]
        finished = [drone.finished for drone in ranked]
        assert finished == sorted(finished, reverse=True)
        for ahead, behind in itertools.pairwise(ranked):
            if behind.finished:
                assert ahead.finish_time <= behind.finish_time
            elif not ahead.finished:
                assert (-ahead.gates_passed, ahead.last_crossing) <= (-behind.gates_passed, behind.last_crossing) or (
                    ahead.gates_passed == behind.gates_passed == 0
                )
        for drone in ranked:
            assert (drone.fate == "finished") == drone.finished
            assert (drone.collision == "") == (drone.fate in ("finished", "time limit"))


def test_overtakes_of_a_known_race():
    nan = math.nan
    times = np.array([[1.0, 2.0, 3.0, 4.0], [1.5, 1.8, 3.5, nan], [2.0, 2.0, 2.5, nan]])
    # The second passes the first and is passed again; the third passes the second. A dead heat is no order.
    found = overtakes(crossing_log(times))
    assert [(one.time, one.drone, one.other, one.crossing) for one in found] == [
        (1.8, 1, 0, 1),
        (2.5, 2, 1, 2),
        (3.0, 0, 1, 2),
    ]
    assert [one.gate for one in found] == [(2 + one.crossing) % 3 for one in found]
    assert race_result(crossing_log(times)).overtakes == 3


def test_crash_times_are_those_of_the_first_collision(paths, measured):
    for path, again in zip(paths, measured, strict=True):
        log = load_race_log(path)
        expected = [
            min(
                (time for kind, by, time, *_ in again["events"] if by == drone and kind in COLLISIONS), default=math.inf
            )
            for drone in range(log.num_drones)
        ]
        np.testing.assert_allclose(crash_times(log), expected, atol=2e-4)


def test_crossing_times_and_lap_length(paths):
    log = load_race_log(paths[0])
    times = crossing_times(log)
    assert times.shape == (6, 13)
    assert (np.diff(times, axis=1)[np.isfinite(times[:, 1:])] > 0).all()
    assert lap_length(log) == pytest.approx(56.8, abs=0.1)


def test_a_nominal_lap_is_that_of_the_track_that_was_flown(paths):
    """Where every race has a track of its own, its own length counts, whatever the first variant's is."""
    log = load_race_log(paths[0])
    doubled = dataclasses.replace(log, gate_position=2 * log.gate_position)
    results = [race_result(log), race_result(doubled)]
    assert results[1].lap_length == pytest.approx(2 * results[0].lap_length)
    for result in results:
        found = summarise(TRACK, log.pilots.tolist(), [result], 0)
        assert found.nominal_lap_time.mean == pytest.approx(result.lap_length / found.mean_speed.mean)


def test_time_is_enough_for_the_longest_variant():
    track = random_tracks(0, 5)
    match = make_match(dataclasses.replace(track, laps=10), 1, "chaser")
    lengths = [track_length(gates) for gates in track.variants]
    assert match.time_limit == pytest.approx(10 * max(lengths) / 1.25)


def test_nothing_to_measure(paths):
    log = load_race_log(paths[0])
    events = {
        field: getattr(log, field)[:0] for field in vars(log) if field.startswith("event_") and "names" not in field
    }
    evaluation = summarise(TRACK, log.pilots.tolist(), [race_result(dataclasses.replace(log, **events))], 0)
    plain = evaluation.to_dict()
    nothing = {"mean": None, "std": None, "low": None, "high": None}
    for name in ("flying_lap_time", "winner_lap_time", "first_lap_time", "nominal_lap_time", "mean_speed", "top_speed"):
        assert plain[name] == nothing
    assert plain["success_rate"]["mean"] == 0.0
    assert plain["collisions_per_race"] == {"mean": 0.0, "std": None, "low": None, "high": None}
    assert [field.name for field in dataclasses.fields(evaluation)][:16] == list(plain)
