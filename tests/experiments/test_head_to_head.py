"""Who is before whom in a race, and who has won it."""

import dataclasses
from functools import cmp_to_key

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cruise.evaluation.metrics import DroneResult
from cruise.storage.race_log import EventKind
from experiments import head_to_head
from experiments.head_to_head import meeting_of, places, winner
from experiments.plan import Job
from tests.storage.logs import small_log

NAN = float("nan")


def drone(finish=NAN, gates=0, collision="") -> DroneResult:
    return DroneResult(not np.isnan(finish), collision, gates, 0, finish, NAN, NAN, (), 4.0, 5.0)


FIRST, SECOND = drone(40.0, 16), drone(42.0, 16)
FLYING, SLOWER = drone(gates=12), drone(gates=9)
CRASHED, EARLIER = drone(gates=15, collision="collision_drone"), drone(gates=1, collision="collision_ground")
# Drones, their places, the index of the winner.
RACES = {
    "both finish": ([SECOND, FIRST], (2, 1), 1),
    "one crashes": ([CRASHED, SECOND], (2, 1), 1),
    "one crashes far ahead of one that is still flying": ([CRASHED, SLOWER], (2, 1), 1),
    "both crash": ([CRASHED, EARLIER], (1, 1), None),
    "nobody finishes in time": ([SLOWER, FLYING], (2, 1), 1),
    "nobody finishes, as far": ([FLYING, FLYING], (1, 1), None),
    "a dead heat": ([FIRST, drone(40.0 + 1e-8, 16)], (1, 1), None),
    "four": ([CRASHED, FIRST, EARLIER, SECOND], (3, 1, 3, 2), 1),
    "two of four share the first place": ([FIRST, FIRST, SECOND, CRASHED], (1, 1, 3, 4), None),
    "all of four crash": ([CRASHED, CRASHED, EARLIER, EARLIER], (1, 1, 1, 1), None),
    "all kinds": ([FLYING, EARLIER, SLOWER, FIRST], (2, 4, 3, 1), 3),
}


@pytest.mark.parametrize("race", RACES)
def test_places_and_winner(race):
    drones, expected, won = RACES[race]
    assert places(drones) == expected
    assert winner(places(drones), [bool(d.collision) for d in drones]) == won


def better(one: DroneResult, other: DroneResult) -> int:
    """An order of its own: -1 where the first is better."""

    def key(result):
        if result.finished:
            return 0, result.finish_time
        return (2, 0) if result.collision else (1, -result.gates_passed)

    return (key(one) > key(other)) - (key(one) < key(other))


outcomes = st.tuples(st.sampled_from([NAN, 40.0, 41.0, 42.0]), st.integers(0, 3), st.just("")) | st.tuples(
    st.just(NAN), st.integers(0, 3), st.just("collision_flip")
)


@given(st.lists(outcomes, min_size=1, max_size=5), st.randoms())
def test_places_follow_an_order_and_not_the_drones_numbers(told, random):
    drones = [drone(*outcome) for outcome in told]
    found = places(drones)
    ordered = sorted(drones, key=cmp_to_key(better))
    assert found == tuple(1 + next(i for i, other in enumerate(ordered) if better(other, d) == 0) for d in drones)
    order = random.sample(range(len(drones)), len(drones))
    assert places([drones[i] for i in order]) == tuple(found[i] for i in order)


def log_of(pilots, finished, crashed, times):
    """A race with these events."""
    events = [(t, d, EventKind.FINISH) for d, t in zip(finished, times, strict=True)]
    events += [(0.1, d, EventKind.COLLISION_GROUND) for d in crashed]
    events.sort()
    time, who, kind = zip(*events, strict=True)
    none = np.full(len(events), -1, np.int32)
    return dataclasses.replace(
        small_log(),
        pilots=np.array(pilots),
        event_time=np.array(time),
        event_drone=np.array(who, np.int32),
        event_kind=np.array([int(k) for k in kind], np.int32),
        event_gate=none,
        event_other=none,
    )


@pytest.mark.parametrize(
    ("races", "field", "shares"),
    [(100, 2, [50, 50]), (100, 4, [25] * 4), (45, 4, [12, 11, 11, 11]), (9, 2, [9]), (25, 4, [13, 12])],
)
def test_entrants_take_turns(races, field, shares, monkeypatch):
    flown = []

    def fly(match, share, seed):
        flown.append((match, share))
        return [small_log()] * share

    monkeypatch.setattr(head_to_head, "make_match", lambda track, drones, team: team)
    monkeypatch.setattr(head_to_head, "run_races", fly)
    pilots = ["a", "b", "c", "d"][:field]
    assert len(head_to_head._fly(Job("head-to-head", "ring", field, 0), pilots, races)) == races
    assert [share for _, share in flown] == shares
    assert [team[0] for team, _ in flown] == pilots[: len(shares)]
    assert all(sorted(team) == pilots for team, _ in flown)


def test_entrants_are_found_by_name_whatever_drone_they_flew():
    logs = [
        log_of(["cruise", "vanilla"], [0, 1], [], [0.3, 0.4]),
        log_of(["vanilla", "cruise"], [0, 1], [], [0.4, 0.3]),
        log_of(["vanilla", "cruise"], [1], [0], [0.2]),
    ]
    meeting = meeting_of(("cruise", "vanilla"), logs)
    assert meeting.rank == ((1, 2), (1, 2), (1, 2))
    assert meeting.finish == ((0.3, 0.4), (0.3, 0.4), (0.2, None))
    assert meeting.crashed == ((False, False), (False, False), (False, True))
