"""Win rates and ratings."""

import dataclasses

import numpy as np
import pytest
from openskill.models import PlackettLuce

from experiments import ratings
from experiments.plan import ENTRANTS, Job, full_scale
from experiments.ratings import field_place, field_survival, field_wins, rate, win_rate
from experiments.results import HeadToHead, Meeting
from tests.experiments.invented import ORIGIN, invent_meetings

SCALE = dataclasses.replace(full_scale(), races=40)


def head_to_head(*meetings: Meeting) -> HeadToHead:
    return HeadToHead(1, "ring", 2, 0, ORIGIN, {}, meetings)


def duel(entrants, ranks, crashed=None) -> Meeting:
    crashed = crashed or [(False, False)] * len(ranks)
    return Meeting(entrants, tuple(ranks), tuple((None, None) for _ in ranks), tuple(crashed))


def test_a_duel_that_nobody_won_counts_for_neither():
    races = duel(
        ("cruise", "vanilla"), [(1, 2), (1, 1), (2, 1), (1, 2)], [(False, True), (True, True)] + [(False, False)] * 2
    )
    met = [head_to_head(races)]
    assert win_rate(met, "cruise", "vanilla").mean == pytest.approx(2 / 4)
    assert win_rate(met, "vanilla", "cruise").mean == pytest.approx(1 / 4)
    assert not win_rate(met, "cruise", "se-ibr").known


def test_rates_of_a_mixed_field_by_hand():
    met = [invent_meetings(Job("head-to-head", "ring", 4, seed), SCALE) for seed in range(3)]
    for i, kind in enumerate(ENTRANTS):
        rank = np.array([m.meetings[0].rank for m in met])[..., i]
        alone = np.array([[race.count(1) == 1 for race in m.meetings[0].rank] for m in met])
        safe = ~np.array([m.meetings[0].crashed for m in met])[..., i]
        finished = np.array([[t[i] is not None for t in m.meetings[0].finish] for m in met])
        assert field_wins(met, kind).mean == pytest.approx(((rank == 1) & alone & safe).mean())
        assert field_survival(met, kind).mean == pytest.approx(finished.mean())
        assert field_place(met, kind).mean == pytest.approx(rank.mean())


def test_one_game_is_rated_as_the_library_rates_it():
    model = PlackettLuce(tau=0.0)
    [[best], [worst]] = model.rate([[model.rating()], [model.rating()]], ranks=[1, 2])
    rated = {r.entrant: r.skill for r in rate([[head_to_head(duel(("se-ibr", "vanilla"), [(1, 2)]))]], resamples=3)}
    assert rated["se-ibr"].mean == pytest.approx(best.mu)
    assert rated["vanilla"].mean == pytest.approx(worst.mu)
    assert rated["cruise"].mean == pytest.approx(25.0)


def test_who_wins_more_is_rated_higher():
    met = [invent_meetings(Job("head-to-head", "ring", drones, 0), SCALE) for drones in (2, 4)]
    rated = rate([met], resamples=20)
    assert [r.entrant for r in rated] == ["cruise", "se-ibr-tuned", "se-ibr", "vanilla"]
    assert all(r.skill.low <= r.skill.mean <= r.skill.high for r in rated)
    assert rated[0].skill.low > rated[-1].skill.high


def test_equals_are_rated_equal():
    even = duel(("cruise", "vanilla"), [(1, 2), (2, 1)] * 50)
    one, other = (r.skill for r in rate([[head_to_head(even)]], resamples=40) if r.entrant in ("cruise", "vanilla"))
    assert one.low < other.high
    assert other.low < one.high


def test_a_rating_is_the_same_every_time():
    met = [[invent_meetings(Job("head-to-head", "ring", 2, seed), SCALE)] for seed in range(2)]
    assert rate(met, resamples=5) == rate(met, resamples=5)


def test_nothing_to_rate():
    assert not any(rating.skill.known for rating in rate([]))
    assert {rating.entrant for rating in ratings.rate([[]])} == set(ENTRANTS)
