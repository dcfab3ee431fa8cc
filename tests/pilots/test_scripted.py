"""Scripted pilots do what they say."""

import jax
import numpy as np
import pytest

from cruise.env.race_env import make_race_env
from cruise.errors import CruiseError
from cruise.pilots.scripted import SCRIPTED
from cruise.presets import TRACKS, VEHICLES
from cruise.rollout import fly, team_rules

RACES = 16


def fly_alone(name, track, laps, steps):
    env = make_race_env(TRACKS[track], 1, VEHICLES["paper"])
    team = [SCRIPTED[name]]
    rules = team_rules(team, 0.25, laps * env.course.num_gates + 1, (RACES,))
    return fly(env, team, rules, jax.random.key(5), steps, (RACES,))


@pytest.mark.parametrize("track", TRACKS)
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


@pytest.mark.parametrize("name", SCRIPTED)
def test_they_fly_the_papers_vehicle_only(name):
    env = make_race_env(TRACKS["ring"], 1, VEHICLES["paper"])
    other = env._replace(dynamics=env.dynamics._replace(action_size=4))
    with pytest.raises(CruiseError, match=f"pilot '{name}' commands 3 accelerations, this vehicle takes 4 numbers"):
        SCRIPTED[name].init(other, (0,), jax.eval_shape(env.reset, jax.random.key(0)))
