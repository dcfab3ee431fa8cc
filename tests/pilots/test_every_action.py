"""Whatever a vehicle's actions mean, scripted pilots and the planner fly it."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from cruise.config import AttitudeLimits, Vehicle
from cruise.env.race_env import make_race_env
from cruise.env.randomise import made_for, perturbation
from cruise.pilots.named import NAMED
from cruise.presets import RANDOMISATION, TRACKS
from cruise.rollout import fly, team_rules
from cruise.vehicles import BATTERIES, VEHICLES

RING = TRACKS["ring"]
PAPER, RACER = VEHICLES["paper"], VEHICLES["racer"]
AIRFRAME = RACER.airframe
WITH_HEADING = replace(AIRFRAME, attitude=AttitudeLimits(yaw="angle"))
FLOWN: dict[str, Vehicle] = {  # by acceleration the paper's vehicle is flown in every other test of these pilots
    **{f"paper by {kind}": replace(PAPER, control=kind) for kind in ("velocity", "position")},
    **{
        f"racer by {kind}": replace(RACER, control=kind)
        for kind in ("acceleration", "velocity", "position", "ctbr", "attitude")
    },
    "racer by attitude and heading": replace(RACER, control="attitude", airframe=WITH_HEADING),
}


STEPS = {"cascade": 600, "rotors": 1250}  # 60 s and 25 s: the paper's vehicle is slower


def fly_three(vehicle, randomisation=None):
    """Chaser, hover and planner side by side, who cannot touch each other."""
    if randomisation is not None:
        vehicle = made_for(vehicle, randomisation)
    perturb = None if randomisation is None else perturbation(RING, vehicle, randomisation)
    env = make_race_env(RING, 3, vehicle, perturb=perturb)
    team = [NAMED[name].for_vehicle(vehicle) for name in ("chaser", "hover", "se-ibr-tuned")]
    rules = team_rules(team, 0.001, env.course.num_gates + 1, (2,))
    return fly(env, team, rules, jax.random.key(7), STEPS[vehicle.flown_by], (2,))


@pytest.mark.parametrize("name", FLOWN)
def test_a_lap_is_flown_and_a_place_is_held(name):
    flight = fly_three(FLOWN[name])
    assert flight.finished[-1][[0, 2]].all()
    assert flight.airborne[-1][1].all()
    moved = np.linalg.norm(flight.position_w[:, :, 1] - flight.position_w[0, :, 1], axis=1)
    assert moved.max() < 0.1


def test_by_attitude_with_delay_battery_wind_and_weight():
    airframe = replace(AIRFRAME, delay=0.01, battery=BATTERIES["racer"], downwash=True)
    vehicle = replace(RACER, control="attitude", airframe=airframe)
    flight = fly_three(vehicle, replace(RANDOMISATION["racer"], gust_speed=0.0).scaled(0.5))
    assert flight.finished[-1][0].all()
    assert flight.airborne[-1][1].all()
