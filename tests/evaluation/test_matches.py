"""Matches: who flies, what is refused, and the same races for the same seed."""

from pathlib import Path

import jax
import numpy as np
import pytest

from cruise.errors import CruiseError
from cruise.evaluation import matches
from cruise.evaluation.matches import Match, evaluate, evaluate_policy, make_match, run_races
from cruise.evaluation.metrics import race_result
from cruise.pilots.scripted import SCRIPTED, Chaser
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.events import EventKind
from cruise.racing.track_file import load_track
from cruise.storage import policy_paths
from tests.storage.policies import write_policy

RING = TRACKS["ring"]


def equal(a, b):
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in vars(a))


def names(match):
    return [pilot.name for pilot in match.team]


def test_pilots_take_turns():
    assert names(make_match(RING, 5, ["chaser", "hover"])) == ["chaser", "hover", "chaser", "hover", "chaser"]
    match = make_match(RING, 3, "chaser", laps=7)
    assert names(match) == ["chaser"] * 3
    assert match.laps == 7
    fast = Chaser(name="fast")
    assert make_match(RING, 2, [fast, "chaser"]).team == (fast, SCRIPTED["chaser"])
    assert make_match(RING, 2, fast).team == (fast, fast)


def test_pilots_with_a_name_fly_what_the_others_fly():
    racer = Chaser(name="fast").for_vehicle(VEHICLES["racer"])
    for match in (make_match(RING, 2, [racer, "hover"]), make_match(RING, 2, "chaser", vehicle="racer")):
        assert {pilot.vehicle for pilot in match.team} == {"racer"}
        assert match.vehicle is VEHICLES["racer"]
    together = make_match(RING, 3, ["chaser", "hover", "chaser"], vehicle="racer").team
    assert together[0] is together[2]
    assert make_match(RING, 1, "chaser").vehicle.name == "paper"


def test_a_policy_named_twice_is_one_pilot(tmp_path):
    path = write_policy(tmp_path / "p")
    match = make_match(RING, 2, [str(path), str(path)])
    assert match.team[0] is match.team[1]


def test_the_shipped_policy_flies_by_default(tmp_path, monkeypatch):
    monkeypatch.setattr(policy_paths, "SHIPPED", tmp_path)
    write_policy(tmp_path / "ring-2")
    assert names(make_match(RING, 2)) == ["ring-2", "ring-2"]
    with pytest.raises(CruiseError, match="no policy is shipped for track 'ring' with 3 drones; shipped: ring-2"):
        make_match(RING, 3)


BAD = {
    "no drones": (lambda: make_match(RING, 0, "chaser"), "drones must be from 1 to 64, got 0"),
    "too many drones": (lambda: make_match(RING, 65, "chaser"), "drones must be from 1 to 64, got 65"),
    "no laps": (lambda: make_match(RING, 2, "chaser", 0), "laps must be from 1 to 100, got 0"),
    "too many pilots": (lambda: make_match(RING, 2, ["chaser"] * 3), "3 pilots for 2 drones"),
    "no pilots": (lambda: make_match(RING, 2, []), "0 pilots for 2 drones"),
    "no such pilot": (lambda: make_match(RING, 2, ["chaser", "ace"]), "policy 'ace' not found"),
    "two vehicles": (lambda: make_match(RING, 2, [Chaser(), Chaser(vehicle="racer")]), "pilots of different vehicles"),
    "no such vehicle": (lambda: make_match(RING, 2, "chaser", vehicle="racr"), "unknown vehicle 'racr': did you mean"),
    "another vehicle": (
        lambda: make_match(RING, 2, [Chaser(), "hover"], vehicle="racer"),
        "pilot 'chaser' was made for vehicle 'paper', this race flies 'racer'",
    ),
    "nothing shipped": (
        lambda: make_match(RING, 2, vehicle="racer-5"),
        "no policy is shipped for track 'ring' with 2 drones and vehicle 'racer-5'",
    ),
    "no races": (lambda: next(run_races(make_match(RING, 1, "chaser"), 0, 0)), "number of races must be from 1"),
    "seed below 0": (lambda: next(run_races(make_match(RING, 1, "chaser"), 1, -1)), "seed must be from 0"),
    "seed too large": (lambda: next(run_races(make_match(RING, 1, "chaser"), 1, 2**40)), "seed must be from 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_refused(case):
    action, message = BAD[case]
    with pytest.raises(CruiseError) as error:
        action()
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_policy_for_another_number_of_drones(tmp_path):
    path = write_policy(tmp_path / "p", name="duel")
    with pytest.raises(CruiseError, match="policy 'duel' was trained for races of 2 drones, this race has 3"):
        evaluate(RING, 3, path, episodes=1)


def test_time_limit_grows_with_the_way():
    assert Match(RING, (SCRIPTED["chaser"],), 3).time_limit == 150.0
    assert Match(RING, (SCRIPTED["chaser"],), 10).time_limit == pytest.approx(10 * 58.95 / 1.25, rel=1e-3)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    return write_policy(tmp_path_factory.mktemp("policy") / "p", name="novice")


@pytest.fixture(scope="module")
def mixed(policy):
    return make_match(RING, 2, ["chaser", policy], laps=1)


@pytest.fixture(scope="module")
def logs(mixed):
    return list(run_races(mixed, 5, seed=3))


def test_mixed_pilots_race_each_other(logs):
    assert logs[0].pilots.tolist() == ["chaser", "novice"]
    chased = [log.event_drone[log.event_kind == EventKind.CROSSING] for log in logs]
    assert sum((drones == 0).sum() for drones in chased) > 20
    assert all(np.abs(log.action).max() <= 1.0 for log in logs)


def test_same_seed_same_races_other_seed_others(mixed, logs):
    assert all(equal(a, b) for a, b in zip(logs, run_races(mixed, 5, seed=3), strict=True))
    other = list(run_races(mixed, 5, seed=4))
    assert not any(np.array_equal(a.position_w[0], b.position_w[0]) for a, b in zip(logs, other, strict=True))


def test_more_races_than_fit_in_a_batch(mixed, monkeypatch):
    monkeypatch.setattr(matches, "DRONES_IN_BATCH", 10)
    logs = list(run_races(mixed, 7, seed=3))
    assert len(logs) == 7
    starts = {log.position_w[0].tobytes() for log in logs}
    assert len(starts) == 7


def test_a_race_of_racers_is_a_log_of_theirs():
    log = next(run_races(make_match(RING, 2, ["chaser", "hover"], laps=1, vehicle="racer"), 1, seed=1))
    assert (log.vehicle, log.control_dt, log.action.shape[2]) == ("racer", 0.02, 4)
    np.testing.assert_allclose(np.diff(log.time), 0.02)
    assert len(log.event_time[log.event_kind == EventKind.FINISH]) == 1  # the chaser has finished
    assert log.time[-1] == pytest.approx(150.0)  # and the other hovered until the time limit


def test_every_race_on_random_tracks_has_its_own_and_its_log_says_which():
    track = load_track("random")
    races = list(run_races(make_match(track, 2, "chaser", laps=1), 12, seed=4))
    known = {tuple(np.round([gate.position_w for gate in gates], 2).ravel()) for gates in track.variants}
    flown = {tuple(np.round(log.gate_position, 2).ravel()) for log in races}
    assert flown <= known
    assert len(flown) > 8
    assert np.mean([race_result(log).drones[0].finished for log in races]) > 0.5


@pytest.mark.parametrize("pilot", ["se-ibr", "examples/pid_pilot.py:Pilot"])
def test_a_pilot_that_must_know_the_track_refuses_random_ones(pilot):
    with pytest.raises(CruiseError, match="must know the track, and 'random' is another one in every race"):
        next(run_races(make_match(load_track("random"), 2, pilot), 1, seed=0))


def test_starts_are_not_those_of_training(mixed, logs):
    """Training with the same seed draws from the seed's key itself."""
    env = matches.race_env(RING, 2, mixed.vehicle)
    trained = np.asarray(jax.jit(env.reset, static_argnums=1)(jax.random.key(3), (5,)).drones.position_w)
    assert not any(np.allclose(log.position_w[0], trained[:, :, e].T) for e, log in enumerate(logs))


def test_results_of_a_policy_file(policy):
    results = evaluate_policy(policy, RING, episodes=5, seed=1)
    assert (results["policy"], results["drones"], results["episodes"], results["track"]) == ("novice", 2, 5, "ring")
    assert results == evaluate(RING, 2, Path(policy), 5, 1).to_dict()
