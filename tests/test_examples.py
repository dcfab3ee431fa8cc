"""The examples fly."""

from pathlib import Path

import numpy as np
import pytest

import cruise
from cruise.evaluation.matches import make_match, run_races
from cruise.evaluation.metrics import race_result
from cruise.export.files import Exporter
from cruise.presets import TRACKS
from cruise.storage.policy_file import read_policy
from tests.storage.policies import write_policy

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.mark.parametrize("track", TRACKS)
def test_the_pid_pilot_flies_every_track_among_others(track):
    match = make_match(TRACKS[track], 2, f"{EXAMPLES}/pid_pilot.py:Pilot", laps=1)
    results = [race_result(log) for log in run_races(match, 4, seed=1)]
    assert match.team[0].name == "PID"
    assert all(drone.finished and drone.missed_gates == 0 for result in results for drone in result.drones)


def test_a_network_of_ones_own_in_onnx(tmp_path, monkeypatch):
    path = write_policy(tmp_path / "duel")
    Exporter.of(read_policy(path), TRACKS["ring"]).onnx(tmp_path / "policy.onnx", "observation")
    monkeypatch.setenv("PILOT_MODEL", str(tmp_path / "policy.onnx"))
    flown = [cruise.race("ring", 2, pilot, laps=1, seed=5) for pilot in (f"{EXAMPLES}/onnx_pilot.py:Pilot", path)]
    assert flown[0].pilots.tolist() == ["ONNX network"] * 2
    length = min(len(log.time) for log in flown)
    assert length > 5
    np.testing.assert_allclose(flown[0].position_w[:length], flown[1].position_w[:length], atol=5e-3)
