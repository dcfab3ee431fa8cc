"""Scripted pilots do what they say."""

import jax
import numpy as np
import pytest

from cruise.env.race_env import make_race_env
from cruise.pilots.scripted import SCRIPTED
from cruise.presets import PAPER_TRACKS, TRACKS, VEHICLES
from cruise.rollout import fly, team_rules

RACES = 16


def fly_alone(name, track, laps, steps, vehicle="paper"):
    env = make_race_env(TRACKS[track], 1, VEHICLES[vehicle])
    team = [SCRIPTED[name].for_vehicle(VEHICLES[vehicle])]
    rules = team_rules(team, 0.25, laps * env.course.num_gates + 1, (RACES,))
    return fly(env, team, rules, jax.random.key(5), steps, (RACES,))


@pytest.mark.parametrize("track", PAPER_TRACKS)
def test_chaser_flies_every_lap_from_every_gate(track):
    flight = fly_alone("chaser", track, laps=2, steps=800)
    assert flight.finished[-1].all()
    assert not flight.crossing.missed.any()
    offset = np.where(flight.crossing.passed, flight.crossing.offset, -1.0)
    assert offset.max() < -0.5  # crosses every gate more than 0.5 m inside its opening


def test_hover_stays_where_it_started():
    flight = fly_alone("hover", "ring", laps=1, steps=300)
    assert flight.airborne.all()
    assert np.abs(flight.position_w - flight.position_w[0]).max() < 0.05
    assert len(flight.action) == 300


def test_chaser_flies_a_racer():
    """Faster than the paper's vehicle can, through every gate."""
    flight = fly_alone("chaser", "figure-eight", laps=2, steps=1500, vehicle="racer")
    assert flight.finished[-1].all()
    assert not flight.crossing.missed.any()
    assert flight.action.shape[1] == 4
    speed = np.linalg.norm(flight.velocity_w, axis=1)[flight.airborne]
    assert 4 < speed.mean() < 7


def test_for_the_papers_vehicle_they_are_what_they_are():
    for pilot in SCRIPTED.values():
        assert pilot.for_vehicle(VEHICLES["paper"]) is pilot
        aboard = pilot.for_vehicle(VEHICLES["racer"])
        assert (aboard.vehicle, aboard.agility) == ("racer", VEHICLES["racer"].agility)
