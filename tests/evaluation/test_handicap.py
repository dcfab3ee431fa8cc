"""Stronger against weaker: the vehicle, what counts as getting past, and the command."""

import json

import numpy as np
import pytest

from cruise.cli.main import main
from cruise.errors import CruiseError
from cruise.evaluation.handicap import behind_at_first, got_past, stronger
from cruise.presets import VEHICLES
from tests.storage.logs import crossing_log

NAN = float("nan")


def test_a_stronger_vehicle_has_more_thrust_that_can_be_commanded_and_nothing_else():
    strong, racer = stronger(VEHICLES["racer"], 0.15), VEHICLES["racer"]
    assert strong.name == "racer+15%"
    assert strong.airframe.rotors.max_thrust == pytest.approx(1.15 * racer.airframe.rotors.max_thrust)
    assert strong.agility == pytest.approx(1.15 * racer.agility)
    assert (strong.mass, strong.inertia, strong.airframe.drag) == (racer.mass, racer.inertia, racer.airframe.drag)
    with pytest.raises(CruiseError, match="vehicle 'paper' has no rotors that could be stronger"):
        stronger(VEHICLES["paper"], 0.15)
    with pytest.raises(CruiseError, match="thrust must be a share above -1 and up to 1, not 3"):
        stronger(VEHICLES["racer"], 3.0)


@pytest.mark.parametrize(
    ("times", "behind", "past"),
    [
        ([[1.0, 2.0, 3.0], [1.1, 2.1, 2.9]], 1, True),
        ([[1.0, 2.0, 3.0], [1.1, 2.1, 3.1]], 1, False),
        ([[1.2, 2.0, NAN], [1.1, NAN, NAN]], 0, False),  # the other crashed: nobody was passed
        ([[1.0, 2.0, 3.0], [NAN, NAN, NAN]], None, None),
    ],
)
def test_to_get_past_is_to_be_behind_at_the_first_gate_and_ahead_at_a_later_one(times, behind, past):
    log = crossing_log(np.array(times))
    assert behind_at_first(log) == behind
    if behind is not None:
        assert got_past(log, behind) == past


def test_the_command_races_one_pilot_in_two_vehicles(capsys):
    flags = ["handicap", "--track", "ring", "--pilot", "chaser", "--thrust", "0.3", "--episodes", "2"]
    assert main([*flags, "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert (found["track"], found["pilot"], found["races"]) == ("ring", "chaser", 2)
    assert sum(found["chances"]) <= 2
    assert 0 <= sum(share["mean"] for share in found["won"]) <= 1
