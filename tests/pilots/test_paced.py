"""A pilot made slower flies the same way in more time."""

from dataclasses import replace

import numpy as np
import pytest

from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.metrics import crossing_times, race_result
from cruise.pilots.paced import Paced
from cruise.presets import TRACKS


def test_a_slower_champion_passes_the_same_gates_later():
    match = make_match(TRACKS["ring"], 2, "racer-ring", laps=1)
    slow = replace(match, team=(Paced(match.team[0], 0.8), match.team[1]))
    (log,) = run_races(slow, 1, seed=3)
    (usual,) = run_races(match, 1, seed=3)
    assert [drone.finished for drone in race_result(log).drones] == [True, True]
    lap, usual_lap = (crossing_times(one)[0, -1] - crossing_times(one)[0, 0] for one in (log, usual))
    assert lap / usual_lap == pytest.approx(1 / 0.8, rel=0.05)
    assert log.pilots.tolist() == ["racer-ring"] * 2
    speed, usual_speed = (np.linalg.norm(one.velocity_w[:, 0], axis=1).max() for one in (log, usual))
    assert speed < 0.9 * usual_speed
