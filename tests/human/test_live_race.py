"""A race with a person in it, step by step."""

import numpy as np

from cruise.cli.fly import Fly
from cruise.human.live_race import LiveRace
from cruise.human.messages import usual_settings
from cruise.human.seats import Seat, controls_of
from cruise.pilots.human import flight_modes
from cruise.presets import VEHICLES
from cruise.storage.race_log import load_race_log

OTHERS = ("kolibri", "cf21B_500")  # one of them is told an attitude
STEPS, PACE = 40, 0.8


def flown(pace, steps, path):
    """The log of a race against chasers in other vehicles, kept and read again; nobody touches the sticks."""
    match = Fly(pilot=("chaser",), rival_vehicle=OTHERS, rival_pace=pace, laps=1)._match()
    race = LiveRace(match, seed=1)
    person = Seat(0, flight_modes(match.vehicle), usual_settings(match.vehicle))
    for _ in range(steps):
        race.step(controls_of([person], 0.0))
    race.log(("human Ada", "chaser", "chaser")).save(path)
    return load_race_log(path)


def test_rivals_of_other_vehicles(tmp_path):
    usual, slow = flown(1.0, STEPS, tmp_path / "1.npz"), flown(PACE, round(STEPS / PACE), tmp_path / "2.npz")
    assert usual.vehicles.tolist() == ["racer", *OTHERS]
    assert usual.names == ("human Ada (racer)", "chaser (kolibri)", "chaser (cf21B_500)")
    assert usual.collision_distance == max(VEHICLES[name].collision_distance for name in ("racer", *OTHERS))
    way, slow_way = (np.linalg.norm(log.position_w[-1] - log.position_w[0], axis=1) for log in (usual, slow))
    assert way[0] < 0.05  # holds
    assert way[1:].min() > 0.4
    np.testing.assert_allclose(slow_way[1:], way[1:], rtol=0.1)  # the same way in more time
