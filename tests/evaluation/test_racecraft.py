"""Racecraft: what is measured of hand-made races with known answers, and scenarios that pilots fly."""

import dataclasses
import itertools
import json

import numpy as np
import pytest

from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.evaluation.racecraft import PILOT, measure_racecraft, run_of
from cruise.evaluation.scenarios import SCENARIOS
from cruise.pilots.named import NAMED
from cruise.pilots.scripted import Chaser
from cruise.presets import TRACKS
from cruise.storage.race_log import NOBODY, EventKind
from tests.storage.logs import crossing_log

RING = TRACKS["ring"]
SEED, RUNS = 3, 1


def race(times, head_starts=(0, 0)):
    """Drones that cross gates at `times` [N, C]; who has all seven of two laps has finished. Nobody touches anybody."""
    log = crossing_log(np.array(times, np.float64))
    next_gate = np.tile(np.array(head_starts, np.int32), (len(log.time), 1))
    done = [(row[-1], drone) for drone, row in enumerate(times) if np.isfinite(row[-1])]
    columns = {
        "event_time": [time for time, _ in done],
        "event_drone": [drone for _, drone in done],
        "event_kind": [EventKind.FINISH] * len(done),
        "event_gate": [0] * len(done),
        "event_other": [NOBODY] * len(done),
    }
    more = {
        name: np.append(getattr(log, name), rows).astype(getattr(log, name).dtype) for name, rows in columns.items()
    }
    return dataclasses.replace(log, next_gate=next_gate, **more)


SOLO = race([[1, 2, 3, 4, 5, 6, 7]], (0,))


def test_a_pass_is_one_from_gate_to_gate_and_time_is_lost_against_the_flight_alone():
    run = run_of(race([[1, 2, 3, 4, 5, 6, 7.5], [0.5, 1.5, 3.5, 4.5, 5.5, 6.5, 8]]), SOLO)
    assert (run.finished, run.first, run.passes, run.places_lost, run.contacts) == (True, True, 1, 0, ())
    assert run.time_lost == pytest.approx(0.5)


def test_who_starts_a_gate_further_on_is_ahead_until_it_is_passed():
    """The other's first crossing is at the pilot's second gate."""
    mine = [1, 2, 3, 4, 5, 6, 7]
    passed = run_of(race([mine, [1.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5]], (0, 1)), SOLO)
    ahead = run_of(race([mine, [1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5]], (0, 1)), SOLO)
    assert (passed.passes, passed.first) == (1, True)
    assert (ahead.passes, ahead.places_lost, ahead.first) == (0, 0, False)


def test_places_are_lost_and_won_back():
    run = run_of(race([[1, 2.5, 3, 4, 5, 6, 7], [1.5, 2, 3.5, 4.5, 5.5, 6.5, 7.5]]), SOLO)
    assert (run.passes, run.places_lost, run.first) == (1, 1, True)


def test_who_does_not_finish_is_not_first_and_lost_no_time():
    run = run_of(race([[1, 2, 3, *[np.nan] * 4], [2, 3, 4, 5, 6, 7, 8]]), SOLO)
    assert (run.finished, run.first) == (False, False)
    assert np.isnan(run.time_lost)


def test_nobody_starts_on_top_of_another():
    for scenario in SCENARIOS:
        places = [scenario.place, *(opponent.place for opponent in scenario.opponents)]
        for a, b in itertools.combinations(places, 2):
            assert a.gate != b.gate or np.hypot(a.back - b.back, a.left - b.left) >= 1.0


@pytest.fixture(scope="module")
def blind():
    """A chaser that looks at nobody, known by its name."""
    NAMED["blind"] = Chaser(name="blind", speed=4.5, push=0.0)
    yield "blind"
    del NAMED["blind"]


@pytest.fixture(scope="module")
def outcomes(blind):
    return measure_racecraft(RING, blind, RUNS, SEED)


def test_all_scenarios_are_flown_as_declared(outcomes):
    for outcome, scenario in zip(outcomes, SCENARIOS, strict=True):
        assert outcome.scenario == scenario
        assert len(outcome.runs) == RUNS
        for run in outcome.runs:
            log = run.log
            assert log.num_drones == scenario.drones
            assert log.airborne[0].all()
            rival = "blind" if scenario.against_itself else "rival"
            assert log.pilots.tolist() == ["blind", *[rival] * (scenario.drones - 1)]
            ahead = (log.next_gate[0] - log.next_gate[0, PILOT]) % log.num_gates
            assert ahead.tolist() == [0, *(opponent.place.gate for opponent in scenario.opponents)]


def test_a_blind_pilot_runs_into_one_ahead_and_leads_an_equal_as_if_alone(outcomes):
    of = {outcome.scenario.name: outcome.runs for outcome in outcomes}
    for run in of["pass"]:
        assert [(contact.rule, contact.fault) for contact in run.contacts] == [("following", (1.0, 0.0))]
        assert (run.finished, run.first, run.passes) == (False, False, 0)
    for run in of["lead"]:
        assert (run.finished, run.first, run.passes, run.contacts) == (True, True, 0, ())
        assert run.time_lost == pytest.approx(0.0, abs=0.02)  # it does not look back
    for run in of["crash ahead"]:
        fallen = run.log.event_drone[run.log.event_kind == EventKind.COLLISION_GROUND]
        assert 1 in fallen or run.contacts


def test_command(outcomes, capsys, tmp_path):
    page, picture = tmp_path / "r.html", tmp_path / "r.png"
    flags = ["--pilot", "blind", "--track", "ring", "--runs", str(RUNS), "--seed", str(SEED)]
    assert main(["racecraft", *flags, "--json", "--html", str(page), "--png", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert found["scenarios"] == [outcome.to_dict() for outcome in outcomes]
    assert "a contact" in page.read_text(encoding="utf-8")
    assert picture.read_bytes().startswith(b"\x89PNG")


NARROW = dataclasses.replace(RING, bounds_low=(-2.0, 3.0, 0.0))  # leaves one gate in place
ANOTHER_IN_EVERY_RACE = dataclasses.replace(RING, variants=(RING.gates, RING.gates))


@pytest.mark.parametrize(
    ("pilot", "track", "runs", "complaint"),
    [
        ("hover", RING, 0, "runs must be from 1"),
        ("nobody", RING, 1, "nobody"),
        ("hover", NARROW, 1, "no two gates in a row with room"),
        ("hover", ANOTHER_IN_EVERY_RACE, 1, "another one in every race"),
    ],
)
def test_what_cannot_be_is_told(pilot, track, runs, complaint):
    with pytest.raises(CruiseError, match=complaint):
        measure_racecraft(track, pilot, runs)
